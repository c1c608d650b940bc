"""Drivers of the grippers.

A new gripper is one file and one line:

1. A module with a class that satisfies `base.Grippers`. `base.GripperPair` has the stroke with its
   deadline, its repetition and its confirmation; a subclass adds `_listen`, `_send`, `_lacks`,
   `_closed` and `_holding`, as `can_bus` and `digital_io` do. Settings that `GripperSite` does not
   have are read from its `options`.
2. A line in `factory.GRIPPERS`: the kind that sites name, and the function that opens it.

A driver outside this package needs no line: its site says `kind: "my_lab.grippers:open_mine"`, and
names a function like `factory.GripperOpener`, or a `GripperKind`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
