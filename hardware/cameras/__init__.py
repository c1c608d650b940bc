"""Drivers of the head's cameras and of the depth camera.

A new camera is one file and one line:

1. A module with a class that is made from a `CameraSite` and satisfies `base.PairCamera`, or
   `base.DepthCamera`. `base.GrabbedPair` makes a pair camera of one function that may hang or fail;
   see `opencv`. Settings that `CameraSite` does not have are read from its `options`.
2. A line in `factory.CAMERAS`: the kind that sites name, and the class.

A driver outside this package needs no line: its site says `kind: "my_lab.cameras:MyCamera"`, and
names such a class, or a `CameraKind`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
