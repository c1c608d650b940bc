"""Where the head looks: vergence on a point, localisation in an image, visual search."""
