"""Commands on a plan file: verify, show, execute, export and document it."""
