"""The page of the benchmark `garments`."""

from benchmarks.harness.statistics import Spread, wilson
from benchmarks.harness.tables import line, rule
from benchmarks.published.garments.baseline_policies import CREST_DRAG, DRAG, LIFT, REACH, SPEED
from benchmarks.published.garments.results import GarmentsResult
from benchmarks.published.garments.trials import GARMENTS, LOOPS, NODES, OURS

_STARTS = {
    "bunched": (
        "Pushed together with two fingers at five places: nearly as wide as flat, wrinkles that cross. What the system is "
        "made for."
    ),
    "pinched": (
        "Lifted at five places and dragged inwards: folds, cloth on cloth. Beyond what pulling single wrinkles out can "
        "do; shown for that reason."
    ),
}


def page(results: GarmentsResult) -> str:
    """Return the page: headline, who is favoured, a table per start kind, published figures."""
    lines = [
        "Cloth and robot are simulated.",
        "",
        (
            "Coverage is the area seen from above as a share of the flat garment's (normalised coverage); improvement is the "
            "share of what the start lacked that was gained, (c - c0) / (1 - c0): 1 is flat, below 0 is worse than before. "
            f"Success is a coverage of at least {100 * results.success_coverage:.0f} % at the end. Means with 95 % "
            "bootstrap intervals."
        ),
        "",
    ]
    if results.unpaired:
        lines += [
            f"NOT PAIRED: the methods' starts differ in {', '.join(results.unpaired)}.",
            "",
        ]
    if results.starts_left_out:
        names = ", ".join(one.start for one in results.starts_left_out)
        lines += [
            f"Left out, since the cloth's solver fails while they are made, and the next seeds taken: {names}.",
            "",
        ]
    for start in results.starts:
        lines += [f"## All garments, {start}", "", *_overall(results, start), ""]
    lines += ["## Who does what, and whom it favours", "", *_rules(results), ""]
    for start in results.starts:
        lines += [f"## {start}", "", _STARTS[start], "", *_cells(results, start), ""]
    lines += [
        "## Published, in other worlds",
        "",
        (
            "Other simulators or robots, other cloths and other starts: for the order of magnitude only, grey in the figure. "
            "Taken from the papers' abstracts; tables of theirs are not quoted."
        ),
        "",
        line("result", "coverage", "source"),
        rule(3),
        *(
            line(f"{one.label}", f"{_range(one.coverage)}", f"{one.source}")
            for one in results.published
        ),
    ]
    return "\n".join([*lines, ""])


def _overall(results: GarmentsResult, start: str) -> list[str]:
    counts = results.counts
    lines = [
        "| method | coverage at first, % | "
        + " | ".join(f"improvement after {count}" for count in counts)
        + " | coverage at the end, % | success (95 % interval) | highest point at the end, mm | actions |",
        "|---|---|" + "---|" * (len(counts) + 4),
    ]
    for method in results.methods:
        one = results.overall[start][method]
        low, high = wilson(one.success, one.runs)
        lines.append(
            f"| {method} | {_text(one.coverage[0], 100, 1)} | "
            + " | ".join(_text(one.improvement[count], 1, 2) for count in counts)
            + f" | {_text(one.coverage[counts[-1]], 100, 1)} "
            f"| {one.success} of {one.runs} ({100 * low:.0f} to {100 * high:.0f} %) "
            f"| {_text(one.height, 1e3, 1)} | {_text(one.actions, 1, 1)} |"
        )
    return lines


def _cells(results: GarmentsResult, start: str) -> list[str]:
    counts = [0, *results.counts]
    last = counts[-1]
    lines = [
        "| garment | method | "
        + " | ".join(f"coverage {'at first' if n == 0 else f'after {n}'}, %" for n in counts)
        + f" | improvement after {last} | success (ever; at first) | first at 95 % after "
        "| best coverage, % | highest point, mm (worst) | actions | moved, cm | over the edge, worst, % | overstretch, worst, % |",
        "|---|---|" + "---|" * (len(counts) + 9),
    ]
    for garment in results.garments:
        for method in results.methods:
            one = results.cells[start][garment][method]
            lines.append(
                f"| {garment} | {method} | "
                + " | ".join(_text(one.coverage[n], 100, 1) for n in counts)
                + f" | {_text(one.improvement[last], 1, 2)} "
                f"| {one.success} of {one.runs} ({one.success_ever}; {one.success_at_start}) "
                f"| {_mean(one.first_success, 1, 1)} | {_mean(one.best, 100, 1)} "
                f"| {_mean(one.height, 1e3, 1)} ({1e3 * one.height_max:.1f}) "
                f"| {_mean(one.actions, 1, 1)} | {_mean(one.moved, 100, 1)} "
                f"| {100 * one.hanging_max:.1f} | {100 * one.overstretch_max:.1f} |"
            )
    lines += [
        "",
        "How ours ended: "
        + "; ".join(
            f"{garment} "
            + ", ".join(
                f"{count} {status}"
                for status, count in results.cells[start][garment][OURS].ended.items()
            )
            for garment in results.garments
        )
        + ".",
    ]
    for method in results.methods:
        one = results.overall[start][method]
        if method not in LOOPS and one.broken + one.idle + one.empty:
            lines.append(
                f"- {method}: of {one.runs * results.most_actions} actions {one.broken} the cloth's solver could not "
                f"follow (the cloth was laid back as it had been), in {one.idle} the policy saw nothing to do, in "
                f"{one.empty} the hand closed on nothing."
            )
    return lines


def _rules(results: GarmentsResult) -> list[str]:
    cloths = ", ".join(f"{name} of {one['material']}" for name, one in GARMENTS.items())
    return [
        (
            "- ours: the closed loop as `unwrinkle flatten --sensor truth` runs it, with the published greedy rule: wrinkles, plans "
            "for two arms, an independent verdict on every motion, simulated arms and grippers. It stops by "
            "itself; what it reached then counts for all later numbers of actions. It sees what the simple ways see (below); "
            "what the rendered stereo head makes of towels is Table II's business."
        ),
        (
            "- together: the same loop with `order: together` and `pull: section`: the section that crosses most wrinkles, pulled by all "
            "the slack along it."
        ),
        (
            "- random: a place on the garment is taken, lifted "
            f"{100 * LIFT:.0f} cm and put down uniformly in a disc of {100 * REACH:.0f} cm around it, on the table."
        ),
        (
            f"- contour: the outline's point farthest from the garment's centroid is pulled {100 * DRAG:.0f} cm outwards along "
            "its ray. Points within 60 degrees of one of the last three pulls wait, or it would be one corner for ever."
        ),
        (
            f"- wrinkledness: the grasp point of the second paper is pulled {100 * CREST_DRAG:.0f} cm away from the garment's "
            "centroid. (The paper grasps there and does not flatten; across the local ridge was tried and is worse.)"
        ),
        (
            f"- Every method has {results.most_actions} actions, and the same starts: "
            f"{', '.join(_seeds_of(results, start) for start in results.starts)}. "
            f"Garments: {cloths}, each on {NODES} nodes along its longer side. Shirt and trousers are one layer of cloth."
        ),
        "",
        (
            "The simple ways are favoured in what they see and can do: a bare hand (one, at most "
            f"{SPEED:g} m/s) reaches every place on the table, never collides, needs no verdict and closes exactly where it "
            "looks. All ways see the true upper surface with the stereo head's noise, without shadows, wrong matches or errors of "
            "segmentation and calibration. Ours is favoured in that it has two hands and stops when it sees nothing more to "
            "do, while they go on and may spoil what they had: the column of the best coverage says what a perfect stop would "
            "have kept. A hand that pulls from one side drags the garment along over the table, two opposite ones "
            "hardly (moved: the way of its middle)."
        ),
    ]


def _seeds_of(results: GarmentsResult, start: str) -> str:
    counts = {len(of) for key, of in results.seeds.items() if key.startswith(f"{start}-")}
    return f"{max(counts)} {start} per garment"


def _text(spread: Spread | None, unit: float, digits: int) -> str:
    if spread is None:
        return "-"
    mean, low, high = (unit * value for value in (spread.mean, spread.low, spread.high))
    return f"{mean:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _mean(spread: Spread | None, unit: float, digits: int) -> str:
    return "-" if spread is None else f"{unit * spread.mean:.{digits}f}"


def _range(coverage: tuple[float, float | None]) -> str:
    low, high = coverage
    return f"over {100 * low:.0f} %" if high is None else f"{100 * low:.0f} % to {100 * high:.0f} %"
