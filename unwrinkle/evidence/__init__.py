"""Evidence on one plan at one site, for a risk assessment.

`motion` samples the plan; `body_motion` computes speeds and energies, `swept` the space that the
bodies pass, `stopping` how far a hold travels; `pack` collects them, `document` writes them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
