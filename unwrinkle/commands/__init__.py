"""Sub-commands of the command line: each public module, also of a folder, holds one of its name."""
