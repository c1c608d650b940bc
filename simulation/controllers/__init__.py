"""The virtual robot controller: a DX100 that speaks MotoROS."""
