"""The compiled XPBD solver of the cloth."""
