"""``unwrinkle controller``: run a virtual robot controller with the protocol of the real one."""

from typing import Annotated

import typer

from unwrinkle.commands._shared.settings import SiteSetOption

EXAMPLES = (
    "unwrinkle controller",
    "unwrinkle controller --fault late=0.3@5-8 --seconds 60",
)


def controller(
    site: Annotated[
        str, typer.Option(help="Site file *.site.yaml, or name of a shipped site: loopback.")
    ] = "loopback",
    changes: SiteSetOption = None,
    profile: Annotated[
        str, typer.Option(help="Points it accepts: groups, ex or both; the site's if left out.")
    ] = "",
    ports: Annotated[
        str,
        typer.Option(help="Ports MOTION,STATE,IO instead of the site's; 0 for any free port."),
    ] = "",
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND[=VALUE][@BEGIN[-END]]", help="Fault to simulate; repeatable."),
    ] = None,
    delay: Annotated[
        float,
        typer.Option(min=0.0, help="Delay from a command to the axes' motion and feedback, s."),
    ] = 0.15,
    firmware: Annotated[
        str, typer.Option(help="Firmware of the controller: 1.9.12 (MotoROS), or 2013.")
    ] = "1.9.12",
    period: Annotated[
        float, typer.Option(help="Interpolation period, s: 0.004, or CloPeMa's 0.008.")
    ] = 0.004,
    lag: Annotated[
        float, typer.Option(min=0.0, help="Time constant of the axes, in addition to the delay, s.")
    ] = 0.0,
    cloth: Annotated[
        bool, typer.Option("--cloth/--no-cloth", help="Whether closed grippers hold cloth.")
    ] = True,
    pan_tilt: Annotated[
        bool, typer.Option("--pan-tilt", help="Run two virtual pan-tilt units as well.")
    ] = False,
    list_faults: Annotated[
        bool, typer.Option("--list-faults", help="List the faults and exit.")
    ] = False,
    seconds: Annotated[
        float | None, typer.Option(min=0.0, help="Exit after this time, s; at Ctrl-C if left out.")
    ] = None,
) -> None:
    """Run a virtual controller until Ctrl-C.

    `unwrinkle execute PLAN --site loopback` connects to it.
    """
    import dataclasses as dc
    import signal
    import time

    from rich.console import Console

    from unwrinkle.simulation.controllers.controller import VirtualControllerSettings
    from unwrinkle.simulation.controllers.server import KINDS, ServerFault
    from unwrinkle.site.sites import find_site, site_cell
    from unwrinkle.site.virtual_equipment import VirtualEquipment

    console = Console()

    def say(text: str) -> None:
        console.print(text, highlight=False, markup=False, soft_wrap=True)

    if list_faults:
        for kind, meaning in KINDS.items():
            say(f"{kind:16} {meaning}")
        return
    found = find_site(site, settings=changes or ())
    settings = dc.replace(
        VirtualControllerSettings.of_site(found.controller),
        delay=delay,
        firmware=firmware,
        period=period,
    )
    if profile:
        settings = dc.replace(settings, accepts=profile)
    cell = site_cell(found)
    equipment = VirtualEquipment(
        found,
        cell.with_speed(1.0).limits,
        cell.robot.named_states["home"],
        settings=settings,
        ports=_ports(ports),
        faults=tuple(map(ServerFault.parse, fault or ())),
        lag=lag,
        cloth=cloth,
        pan_tilt=pan_tilt,
    )
    # Ctrl-C ends it even if the shell ignores it for background jobs; so does SIGTERM.
    before = {
        number: signal.signal(number, signal.default_int_handler)
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        motion, state, io = equipment.server.ports
        say(
            f"virtual controller on {found.controller.host}: motion {motion}, state {state}, I/O "
            f"{io}"
        )
        for side, device in zip(("left", "right"), equipment.devices, strict=False):
            say(f"pan-tilt unit, {side}: {device}")
        say("Ctrl-C ends it")
        begin = now = time.monotonic()
        while seconds is None or now - begin < seconds:
            for text in equipment.step(now):
                say(f"{now - begin:9.3f} s  {text}")
            equipment.server.wait(0.5 * settings.period)
            now = time.monotonic()
    except KeyboardInterrupt:
        say("ended")
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        equipment.close()


def _ports(text: str) -> tuple[int, int, int] | None:
    """Parse three port numbers; None if the option is empty.

    Raises:
        InputError: it is not three port numbers.
    """
    from unwrinkle.models.errors import InputError

    if not text:
        return None
    parts = text.split(",")
    if len(parts) != 3 or not all(part.strip().isdigit() and int(part) < 65536 for part in parts):
        raise InputError(f"--ports {text}: give three port numbers, e.g. 50240,50241,50242")
    return int(parts[0]), int(parts[1]), int(parts[2])
