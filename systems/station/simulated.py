"""Station in its `sim` form: robot, grippers, head, cameras and cloth are simulated.

The ports are those of the other forms. In addition, a simulated station has these outputs:

==================  ==============================================================
output              meaning
==================  ==============================================================
`truth.cloth`       `ClothState`
`truth.coverage`    vector (1,): share of the flat garment's area covered from above
`truth.height`      vector (1,): m, largest height above the flat-lying cloth
`truth.tips`        vector (32,): X_WT (2, 4, 4) of the right and the left tool
==================  ==============================================================
"""

from pydrake.systems.framework import DiagramBuilder

from unwrinkle.simulation.arms.trajectory_player import PlayerSettings
from unwrinkle.systems.station.arm_controller import ArmControllerSystem
from unwrinkle.systems.station.world import ControlsBuilder, StationControls, World


def direct_controls(player: PlayerSettings | None = None) -> ControlsBuilder:
    """Return a builder of controls without connections: the trajectory player drives the axes, and
    commands go to the simulated devices.

    Args:
        player: settings of the arms' controller; the defaults if left out.
    """

    def build(builder: DiagramBuilder, world: World) -> StationControls:
        settings = world.cell.scenario.station
        controller = builder.AddSystem(
            ArmControllerSystem(
                world.cell,
                world.start,
                step=settings.plant_step,
                feedback_period=settings.feedback_period,
                settings=player,
            )
        )
        measured = world.measured
        for name in ("position", "velocity"):
            builder.Connect(measured[name], controller.GetInputPort(name))
        return StationControls(
            inputs={
                "trajectory": controller.GetInputPort("trajectory"),
                "gripper.command": world.grippers.GetInputPort("command"),
                "head.command": world.units.GetInputPort("command"),
                "speed_override": controller.GetInputPort("speed_override"),
            },
            outputs={
                "joints.position_measured": measured["position"],
                "joints.velocity_measured": measured["velocity"],
                "controller.status": controller.GetOutputPort("status"),
                "gripper.status": world.grippers.GetOutputPort("status"),
                "head.position_measured": world.units.GetOutputPort("position"),
            },
            desired=controller.GetOutputPort("desired"),
            reference=controller.GetOutputPort("reference"),
            head=world.units.GetOutputPort("status"),
        )

    return build
