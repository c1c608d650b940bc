from .replay import (
    cell_of as cell_of,
    draw_plan as draw_plan,
    plan_of as plan_of,
    replay_page as replay_page,
)
from .summary import event_rows as event_rows, summary_rows as summary_rows
