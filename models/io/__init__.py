"""Reading and writing of files: typed YAML, archives of arrays, whole files or none."""
