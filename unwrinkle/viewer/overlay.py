"""Panel of a preview page: hash, verdict, list of poses, layers, legend."""

from dataclasses import dataclass
from html import escape

from markupsafe import Markup

from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.viewer.pages import filled_page
from unwrinkle.viewer.plan_shapes import Colours, pull_magnification
from unwrinkle.viewer.playback import Playback
from unwrinkle.viewer.scene import ILLUSTRATION, OVERVIEW, PROXIMITY

#: Content security policy: the page may run its own scripts and read its own content, and nothing
#: else.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob: data:; "
    "style-src 'unsafe-inline'; connect-src data: blob:; img-src data: blob:; font-src data:; "
    "worker-src blob: data:"
)
#: Maximum number of listed violations.
_MOST_LINES = 8


@dataclass(frozen=True)
class PreviewSummary:
    """Result of a plan's verification, for a preview.

    Attributes:
        passed: whether the plan is verified.
        clearance: smallest distance of two bodies that must not touch, m; None if none came near.
        pair: names of these bodies.
        time: time of the smallest clearance on the plan's clock, s.
        lines: further sentences, violations first.
    """

    passed: bool
    clearance: float | None
    pair: str = ""
    time: float | None = None
    lines: tuple[str, ...] = ()

    @classmethod
    def of(cls, verdict: Verdict) -> "PreviewSummary":
        """Return the summary of a verdict."""
        lines = tuple(violation.message for violation in verdict.violations)
        near = verdict.smallest
        if near is None:
            beyond = f"no two bodies nearer than {1e3 * verdict.elsewhere:.0f} mm"
            return cls(verdict.passed, None, lines=(*lines, beyond))
        return cls(verdict.passed, near.distance, " – ".join(near.bodies), near.time, lines)

    @property
    def clearance_text(self) -> str:
        """Return the smallest clearance with its pair and time, in one line."""
        if self.clearance is None:
            return "no smallest clearance"
        text = f"{1e3 * self.clearance:.1f} mm"
        if self.pair:
            text += f", {self.pair}"
        return text if self.time is None else f"{text}, at {self.time:.2f} s"


def page_with_overlay(
    page: str,
    plan: FlatteningPlan,
    playback: Playback,
    summary: PreviewSummary,
    colours: Colours,
    *,
    title: str = "",
    at: float | None = None,
) -> str:
    """Add the panel to a page of Meshcat's `StaticHtml`, and forbid the page every request.

    Args:
        page: page from Meshcat.
        plan: plan that the page shows.
        playback: playback of the plan.
        summary: result of its verification.
        colours: colours of the scene.
        title: name of the capture; may be empty.
        at: time of the plan's clock at which the page opens, paused, s; None to open it playing.

    Returns:
        The page with the panel.
    """
    short = plan.content_hash[:12]
    points = [hand.p_WG.tolist() for hand in plan.target.hands]
    views = _views(plan, points)
    data = {
        "at": at,
        "duration": playback.duration,
        "views": views,
        "times": [step.time for step in playback.steps],
        "labels": _labels(plan),
    }
    panel = filled_page(
        "unwrinkle.viewer",
        "overlay.html",
        title=title,
        short=short,
        hash=plan.content_hash,
        verdict=Markup(_verdict(summary)),
        facts=Markup(_facts(plan, playback)),
        steps=Markup(_steps(playback, colours)),
        layers=Markup(_layers(plan, colours)),
        views=views,
        data=data,
    )
    heading = f"Flattening plan {short}" + (f": {title}" if title else "")
    before, body, after = closed_page(page, heading).rpartition("</body>")
    return f"{before}{panel}\n{body}{after}"


def closed_page(page: str, title: str) -> str:
    """Set the title of a page of Meshcat's `StaticHtml`, and forbid it every request."""
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{escape(title)}</title>", 1)
    return page.replace("<meta charset=utf-8>", f"<meta charset=utf-8>\n  {policy}", 1)


def _verdict(summary: PreviewSummary) -> str:
    state = ("pass", "verified") if summary.passed else ("fail", "NOT verified")
    lines = [f"<li>{escape(line)}</li>" for line in summary.lines[:_MOST_LINES]]
    if len(summary.lines) > _MOST_LINES:
        lines.append(f"<li>and {len(summary.lines) - _MOST_LINES} more</li>")
    listed = f"<ul>{''.join(lines)}</ul>" if lines else ""
    return (
        f'<p class="verdict {state[0]}"><b>{state[1]}</b> smallest clearance '
        f"<b>{escape(summary.clearance_text)}</b></p>{listed}"
    )


def _facts(plan: FlatteningPlan, playback: Playback) -> str:
    arms = "both arms" if plan.dual else "one arm"
    pulls = [
        f"{1e3 * choice.share * plan.target.hands[choice.side].pull_distance:.1f} mm ({name})"
        for name, choice in zip(("right", "left"), plan.arms, strict=True)
        if choice is not None
    ]
    lasts = f"motion {plan.motion_time:.2f} s, with the grippers {playback.duration:.2f} s"
    facts = [
        f"{arms}; {lasts}, at {plan.speed:.0%} of the catalogue speed",
        f"pull {' and '.join(pulls)}",
    ]
    if plan.note:
        facts.append(plan.note)
    return "".join(f"<p>{escape(fact)}</p>" for fact in facts)


def _steps(playback: Playback, colours: Colours) -> str:
    rows, pose = [], 0
    for k, step in enumerate(playback.steps):
        mark = '<i class="event"></i>'
        if step.pose:
            mark = f'<i style="background:{colours.poses[pose % len(colours.poses)]}"></i>'
            pose += 1
        number = f"{pose} " if step.pose else ""
        rows.append(
            f'<button class="step" data-step="{k}">{mark}<span>{number}{escape(step.name)}</span>'
            f"<time>{step.time:.2f} s</time></button>"
        )
    return "".join(rows)


def _layers(plan: FlatteningPlan, colours: Colours) -> str:
    seen = plan.garment is not None
    times = pull_magnification(plan)
    layers = [
        ("plan/garment", "garment as observed", "#b0a090", True, seen),
        ("plan/outline", "its contour", colours.outline, True, seen),
        ("plan/wrinkle", "the wrinkle's ridge line", colours.ridge, True, True),
        ("plan/grasp", "grasp: approach of the fingers", colours.grasp, True, True),
        ("plan/pull", f"pull, {times} times as long", colours.pull, True, True),
        ("plan/poses", "the seven poses of each tool", colours.poses[3], True, True),
        ("plan/tip path", "paths of the fingertips (right, left)", colours.arms, True, True),
        (ILLUSTRATION, "robot and cell", "#2a5ca8", True, True),
        (PROXIMITY, "shapes used by the collision checks", "#e51a1a", False, True),
    ]
    rows = []
    for path, text, colour, shown, there in layers:
        if not there:
            continue
        shades = [colour] if isinstance(colour, str) else list(colour)
        marks = "".join(f'<i style="background:{shade}"></i>' for shade in shades)
        checked = " checked" if shown else ""
        rows.append(
            f'<label><input type="checkbox" data-layer="{path}"{checked}>{marks}{text}</label>'
        )
    return "".join(rows)


def _labels(plan: FlatteningPlan) -> list[dict[str, object]]:
    """Return the labels' texts and their points in the world frame, m."""
    labels: list[dict[str, object]] = []
    for name, choice in zip(("right", "left"), plan.arms, strict=True):
        if choice is not None:
            hand = plan.target.hands[choice.side]
            pull = choice.share * hand.pull_distance
            x, y = (
                hand.p_WG[:2] - (0.05 + 0.5 * pull_magnification(plan) * pull) * hand.pull_direction
            )
            point = [float(x), float(y), float(hand.p_WG[2]) + 0.03]
            labels.append({"text": f"{name} pull {1e3 * pull:.1f} mm", "point": point})
    return labels


def _views(plan: FlatteningPlan, points: list[list[float]]) -> dict[str, list[list[float]]]:
    """Return the camera and target of each view, world frame, m."""
    x, y, z = plan.target.p_WC.tolist()
    views = {
        "overview": [list(point) for point in OVERVIEW],
        "garment": [[x + 0.25, y - 1.15, z + 0.75], [x, y, z]],
        "above": [[x, y - 0.02, z + 1.5], [x, y, z]],
    }
    for name, choice in zip(("right", "left"), plan.arms, strict=True):
        if choice is not None:
            gx, gy, gz = points[choice.side]
            side = -1.0 if gx < x else 1.0
            views[f"{name} grasp"] = [[gx + 0.25 * side, gy - 0.5, gz + 0.28], [gx, gy, gz + 0.03]]
    return views
