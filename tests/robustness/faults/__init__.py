"""The injections of the fault catalogue."""
