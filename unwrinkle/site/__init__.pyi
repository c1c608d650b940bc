from .check import check_site as check_site
from .preflight_checks import (
    check_governor as check_governor,
    check_groups as check_groups,
    check_log as check_log,
    check_margins as check_margins,
    check_speed as check_speed,
    check_tips as check_tips,
    governed_speed as governed_speed,
)
from .queue_clearing import clear_confirmed as clear_confirmed
from .sites import find_site as find_site, site_cell as site_cell
from .virtual_equipment import VirtualEquipment as VirtualEquipment
