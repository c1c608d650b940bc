from .localization import locate as locate
from .vergence import Centring as Centring, centre as centre, quantised as quantised
from .visual_search import Instance as Instance, search as search
