"""The stream of trajectory points: clock along the path, changes of rate, checks before sending."""
