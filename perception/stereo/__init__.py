"""From a pair of images of the stereo head to a range map: rectification, dense matching, heights."""
