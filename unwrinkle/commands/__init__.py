"""The sub-commands: each public module here holds one function of the module's own name."""
