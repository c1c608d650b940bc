"""The cell, plans and live runs in the browser."""
