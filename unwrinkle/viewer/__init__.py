"""Browser views of the cell, of plans and of live runs."""
