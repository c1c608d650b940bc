"""Devices of a site: find, connect and check them."""
