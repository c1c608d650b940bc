"""The page of the benchmark."""

from collections.abc import Callable, Sequence

from benchmarks.harness.statistics import Spread
from benchmarks.harness.tables import line, rule
from benchmarks.published.sensitivity.conditions import DEFAULT, MANY_STARTS, STEREO, TRUTH
from benchmarks.published.sensitivity.results import ConditionFigures, SensitivityResult

_LOOKS = {
    TRUTH: "Rules and cloth: seen as true maps with the stereo head's noise",
    STEREO: "Sensor: seen by the stereo head",
}
#: Of fewer starts nothing is said at all: their intervals mean nothing.
_TELLING = 4


def page(results: SensitivityResult) -> str:
    """Tables by what looked, and what follows for the defaults.

    Args:
        results: as `sensitivity.run` returns them.
    """
    conditions = results.conditions
    lines = [
        (
            "**Cloth and robot are simulated.** Crumpled towels (bunched), flattened by the whole loop; each condition changes one thing "
            f"about the default, at most {results.most_actions} actions. The k-th start of every condition is the same: where the "
            "cloth's material is the setting, the towel is bunched as the default one, gets the other material and settles. The "
            "published rules are: the largest wrinkle first, through its centre, by Eq. 5 between the contours (paper, alone). The "
            "samples are small: read the intervals, not the means. What has nothing to do with pictures is run on true maps, at a "
            "third of the cost of rendered pictures and on more starts for it; the default stands in both tables."
        ),
        "",
        (
            "The default: foot reading of Eq. 5 x 1.2 + 4 mm for each hand, order by volume, section through the centre, slack "
            "of the wrinkle alone; friction 0.6, terry; noise x 1, image size 0.5."
        ),
    ]
    for look, title in _LOOKS.items():
        of = [condition for condition in conditions if condition.look == look]
        if of:
            lines += ["", f"## {title}", "", *_table(of)]
    return "\n".join([*lines, "", "## Defaults chosen, and why", "", *_verdict(conditions), ""])


def _table(conditions: Sequence[ConditionFigures]) -> list[str]:
    lines = [
        (
            line(
                "setting",
                "value",
                "runs",
                "actions: mean (std)",
                "95 % of mean",
                "more than the default, same starts (95 %)",
                "ended flat",
                "flat by truth",
                "missed grasps",
                "coverage at the end, mean",
                "true height, most",
                "overstretch, most",
            )
        ),
        rule(12),
    ]
    for c in conditions:
        low, high = c.rni_interval
        count = c.runs
        lines.append(
            line(
                f"{c.setting}",
                f"{c.value}",
                f"{count}",
                f"{c.rni_mean:.1f} ({c.rni_std:.2f})",
                f"{low:.1f} to {high:.1f}",
                f"{_difference(c.to_default)}",
                f"{count - c.unfinished} of {count}",
                f"{c.flat_by_truth} of {count}",
                f"{c.missed}",
                f"{100 * c.coverage_mean:.1f} %",
                f"{1e3 * c.height_max:.1f} mm",
                f"{100 * c.overstretch_max:.1f} %",
            )
        )
    return lines


def _difference(spread: Spread | None) -> str:
    if spread is None:
        return "-"
    return f"{spread.mean:+.1f} ({spread.low:+.1f} to {spread.high:+.1f})"


def _name(condition: ConditionFigures) -> str:
    what = f"{condition.setting} {condition.value}".strip()
    return what if condition.look == STEREO else f"{what}, on true maps"


def _verdict(conditions: Sequence[ConditionFigures]) -> list[str]:
    """What beats the default, or is worse, by more than its interval.

    And what leaves towels that are not flat.
    """
    changed = [
        (c, c.to_default)
        for c in conditions
        if c.setting != DEFAULT and c.to_default and c.to_default.count >= _TELLING
    ]
    lines = []
    sorts: tuple[tuple[str, Callable[[Spread], bool]], ...] = (
        (
            "Fewer actions than the default by more than the interval (four starts or more)",
            lambda s: s.high < 0.0,
        ),
        (
            "More actions than the default by more than the interval (four starts or more)",
            lambda s: s.low > 0.0,
        ),
    )
    for text, tells in sorts:
        found = [
            f"{_name(c)} ({_difference(more)}, {c.runs} starts)"
            for c, more in changed
            if tells(more)
        ]
        lines.append(f"- {text}: {'; '.join(found) or 'none'}.")
    left = [
        f"{_name(c)} ({c.flat_by_truth} of {c.runs})"
        for c in conditions
        if c.flat_by_truth < c.runs
    ]
    lines.append(f"- Towels that are not flat by truth at the end: {'; '.join(left) or 'none'}.")
    lines.append(
        "- A default is changed only by a condition of the scenario's `loop` that needs fewer actions by more than its interval, on "
        f"{MANY_STARTS} starts or more, and leaves no towel unflat; friction, stiffness, noise and image size are not chosen but given: what counts "
        "there is that the loop ends flat all the same."
    )
    rules = [(c, more) for c, more in changed if c.loop and c.runs >= MANY_STARTS]
    better = [c for c, more in rules if more.high < 0.0 and c.flat_by_truth == c.runs]
    what = "; ".join(_name(c) for c in better)
    lines.append(
        (
            f"- By that rule: {what} would be the better default. It is an option (`order: together`, `pull: section`), and the default "
            "stays the published order for now: the hands pull up to twice as far by it, in one motion, and whether a real towel "
            "bears that between two grippers nobody has tried. Table II has both rules on the same starts, seen by the stereo head."
        )
        if better
        else "- By that rule the defaults stay as they are; the other rules are options of the scenario's `loop`."
    )
    return lines
