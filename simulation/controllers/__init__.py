"""The virtual robot controller: a DX100 with MotoROS."""
