"""Sub-commands of the command line: each public module holds one command of the module's name."""
