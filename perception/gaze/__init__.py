"""Gaze of the stereo head: vergence, sub-pixel localization, visual search."""
