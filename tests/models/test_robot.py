"""The cell's models: golden values of the robot's kinematics, limits, hashes."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.tree import JointIndex

from unwrinkle.models.errors import InputError
from unwrinkle.models.limits import load_limits
from unwrinkle.models.robot import (
    Cell,
    build_robot_diagram,
    load_cell,
    model_file,
    position_indices,
)
from unwrinkle.models.scenario import load_scenario, resolve

BENT = np.array([0.3, 0.2, -0.1, 0.4, 0.5, -0.6])


class Twin:
    """Poses of frames in the cell's plant."""

    def __init__(self, cell: Cell) -> None:
        self.diagram = build_robot_diagram(cell)
        self.plant = self.diagram.plant()
        self.context = self.plant.CreateDefaultContext()
        self.indices = position_indices(cell, self.plant)

    def pose(self, instance: str, frame: str, axes, head=None):
        q = self.plant.GetPositions(self.context)
        q[self.indices.axes] = axes
        if head is not None:
            q[self.indices.head] = head
        self.plant.SetPositions(self.context, q)
        model = self.plant.GetModelInstanceByName(instance)
        return self.plant.GetFrameByName(frame, model).CalcPoseInWorld(self.context)


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell()


@pytest.fixture(scope="module")
def twin(cell: Cell) -> Twin:
    return Twin(cell)


@pytest.mark.parametrize(
    ("gripper", "turn", "arm", "p_WE", "approach", "precision"),
    [
        ("r1", 0.0, 0 * BENT, (-0.4426, -0.8200, 1.3996), (0.2588, 0, -0.9659), 5e-5),
        ("r2", 0.0, 0 * BENT, (0.4426, -0.8200, 1.3996), (-0.2588, 0, -0.9659), 5e-5),
        (
            "r1",
            0.7,
            BENT,
            (0.509682, -0.993086, 1.284946),
            (0.187484, -0.247850, -0.950484),
            5e-7,
        ),
        (
            "r2",
            0.7,
            BENT,
            (1.123058, -0.476446, 1.204001),
            (-0.174333, -0.552605, -0.815007),
            5e-7,
        ),
    ],
)
def test_golden_tool_poses(twin, gripper, turn, arm, p_WE, approach, precision):
    X_WE = twin.pose(f"{gripper}_gripper", "ee", [turn, *arm, *arm])
    assert np.abs(X_WE.translation() - p_WE).max() <= precision
    assert np.abs(X_WE.rotation().matrix()[:, 2] - approach).max() <= precision


def test_golden_flange_pose_in_the_arm_base(twin):
    for q, p, R in (
        (0 * BENT, (0.820, 0, 1.064), np.diag([1.0, -1.0, -1.0])),
        (
            BENT,
            (0.988589, 0.240125, 0.875794),
            [
                [0.502633, 0.806873, 0.310347],
                [0.861159, -0.435784, -0.261722],
                [-0.075933, 0.398808, -0.913885],
            ],
        ),
    ):
        axes = [0.2, *q, *q]
        X_BF = twin.pose("r1", "link_1", axes).inverse() @ twin.pose("r1", "tip_link", axes)
        assert np.abs(X_BF.translation() - p).max() <= 5e-7
        assert np.abs(X_BF.rotation().matrix() - R).max() <= 5e-7


def test_named_state_looks_down_on_the_table(cell, twin):
    X_WX = twin.pose("r1", "xtion", cell.robot.named_states["xtion1_above_table"])
    assert np.abs(X_WX.translation() - [-0.113, -1.027, 1.800]).max() <= 5e-4
    assert np.abs(X_WX.rotation().matrix()[:, 2] - [-0.024, 0.0, -0.9997]).max() <= 5e-4


def test_calibrated_head(twin):
    zero = np.zeros(13)
    left = twin.pose("left_ptu", "mount", zero, np.zeros(4))
    right = twin.pose("right_ptu", "mount", zero, np.zeros(4))
    assert np.abs(left.translation() - [0.107, 0.447, 2.447]).max() <= 1e-3
    assert np.abs(right.translation() - [-0.173, 0.424, 2.431]).max() <= 1e-3
    assert np.abs(left.rotation().matrix()[:, 0] - [-0.05, -0.81, -0.58]).max() <= 5e-3
    raised = twin.pose("left_ptu", "mount", zero, [0.0, 0.1, 0.0, 0.0])
    assert raised.rotation().matrix()[2, 0] > left.rotation().matrix()[2, 0]
    turned = twin.pose("left_ptu", "mount", zero, [0.1, 0.0, 0.0, 0.0])  # +pan: to the robot's left
    assert turned.rotation().matrix()[0, 0] > left.rotation().matrix()[0, 0]


def test_tool_centre_point_is_the_lowest_edge_when_tilted(cell, twin):
    """With the tool tilted towards the table nothing of the gripper lies below the tool centre
    point.
    """
    plant, scene_graph = twin.plant, twin.diagram.scene_graph()
    X_WT = twin.pose("r1_gripper", "tcp", np.zeros(13))
    inspector = scene_graph.model_inspector()
    for tilt in np.radians([30.0, 45.0, 60.0, 75.0]):
        # Direction "down" in the tool's frame: z is the approach, tilted below the horizontal, y up
        # the blades.
        down_T = np.array([0.0, -np.cos(tilt), np.sin(tilt)])
        lowest = -np.inf
        for name in ("palm", "lower_finger", "upper_finger"):
            body = plant.GetBodyByName(name, plant.GetModelInstanceByName("r1_gripper"))
            X_TB = X_WT.inverse() @ plant.EvalBodyPoseInWorld(twin.context, body)
            frame = plant.GetBodyFrameIdOrThrow(body.index())
            for geometry in inspector.GetGeometries(frame):
                half = 0.5 * np.array(inspector.GetShape(geometry).size())
                X_TG = X_TB @ inspector.GetPoseInFrame(geometry)
                corners = half * np.array(np.meshgrid(*3 * [[-1, 1]])).reshape(3, -1).T
                lowest = max(
                    lowest,
                    float(
                        (corners @ X_TG.rotation().matrix().T + X_TG.translation())
                        .dot(down_T)
                        .max()
                    ),
                )
        assert lowest <= 1e-9


def test_plant_has_the_limits_of_the_limits_file(cell, twin):
    plant = twin.plant
    assert np.array_equal(plant.GetPositionLowerLimits()[twin.indices.axes], cell.limits.lower)
    assert np.array_equal(plant.GetPositionUpperLimits()[twin.indices.axes], cell.limits.upper)
    assert np.allclose(np.degrees(cell.limits.lower[1:7]), [-170, -90, -80, -150, -45, -199])
    assert np.allclose(np.degrees(cell.limits.upper[1:7]), [170, 155, 92, 150, 180, 199])
    assert np.allclose(np.degrees(cell.limits.velocity[:7]), [163, 220, 200, 220, 410, 410, 610])
    assert np.array_equal(plant.GetAccelerationUpperLimits()[:1], cell.limits.acceleration[:1])


def test_arm_weighs_about_what_the_catalogue_says(twin):
    plant = twin.plant
    instance = plant.GetModelInstanceByName("r1")
    mass = sum(plant.get_body(i).default_mass() for i in plant.GetBodyIndices(instance))
    assert 125.0 < mass < 135.0


def test_every_axis_turns_about_its_own_z(twin):
    plant = twin.plant
    revolute = [plant.get_joint(JointIndex(i)) for i in range(plant.num_joints())]
    axes = [j for j in revolute if j.type_name() == "revolute" and "joint_" in j.name()]
    assert len(axes) == 12
    assert all(np.array_equal(j.revolute_axis(), [0.0, 0.0, 1.0]) for j in axes)


def test_hashes_follow_the_cell(cell, tmp_path):
    moved = tmp_path / "cell.dmd.yaml"
    text = resolve("package://unwrinkle_models/cell.dmd.yaml").read_text()
    moved.write_text(text.replace("[0, -1.2, 0.70]", "[0, -1.2, 0.72]"))
    other = load_cell(dc.replace(cell.scenario, directives=[str(moved)]))
    assert other.robot_hash != cell.robot_hash
    assert other.limits_hash == cell.limits_hash
    assert cell.with_speed(0.5).limits_hash != cell.limits_hash
    assert cell.with_speed(0.5).robot_hash == cell.robot_hash


def test_limits_file_faults_are_named(tmp_path):
    text = resolve("package://unwrinkle_models/limits.yaml").read_text()
    broken = tmp_path / "limits.yaml"
    broken.write_text(text.replace("planning_fraction:", "planing_fraction:"))
    with pytest.raises(InputError, match="planing_fraction"):
        load_limits(broken)
    broken.write_text(text.replace("effort: 2000 ", "effort: -1 "))
    with pytest.raises(InputError, match="not positive"):
        load_limits(broken)


def test_scenario_faults_are_named(tmp_path):
    path = tmp_path / "site.scenario.yaml"
    path.write_text("Lab:\n  sped: 0.2\n")
    with pytest.raises(InputError, match="sped"):
        load_scenario(path)
    path.write_text("Lab:\n  speed: 1.2\n")
    with pytest.raises(InputError, match=r"speed is 1\.2"):
        load_scenario(path)
    path.write_text("A: {speed: 0.1}\nB: {speed: 0.2}\n")
    with pytest.raises(InputError, match="A, B"):
        load_scenario(path)
    assert load_scenario(path, "B").speed == 0.2
    with pytest.raises(InputError, match="no scenario 'C'"):
        load_scenario(path, "C")
    with pytest.raises(InputError, match="no such file"):
        load_scenario(tmp_path / "absent.yaml")


def test_directives_that_do_not_parse_are_named(cell, tmp_path):
    broken = tmp_path / "broken.dmd.yaml"
    broken.write_text("directives:\n- add_wheel: {name: x}\n")
    with pytest.raises(InputError, match=r"broken\.dmd\.yaml"):
        build_robot_diagram(load_cell(dc.replace(cell.scenario, directives=[str(broken)])))


def test_hash_covers_models_that_a_directives_file_of_the_user_names(cell, tmp_path):
    """Regression: the shape of an obstacle outside the package was not hashed."""
    sdf = (
        "<sdf version='1.9'><model name='post'><link name='post'><collision "
        "name='c'><geometry><box>"
        "<size>0.1 0.1 {height}</size></box></geometry></collision></link></model></sdf>"
    )
    model = tmp_path / "post.sdf"
    extra = tmp_path / "post.dmd.yaml"
    extra.write_text(f"directives:\n- add_model: {{name: post, file: file://{model}}}\n")
    scenario = dc.replace(cell.scenario, directives=[*cell.scenario.directives, str(extra)])
    hashes = set()
    for height in (0.5, 1.5):
        model.write_text(sdf.format(height=height))
        hashes.add(load_cell(scenario).robot_hash)
    assert len(hashes) == 2 and cell.robot_hash not in hashes


TETRAHEDRON = (
    "v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv 0 0 {size}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
)
MODELS = {
    "post.sdf": "<sdf version='1.9'><model name='post'><link name='post'><collision name='c'><geometry><mesh>"
    "<uri>{uri}</uri></mesh></geometry></collision></link></model></sdf>",
    "post.urdf": "<robot name='post'><link name='post'><collision name='c'><geometry><mesh filename='{uri}'/>"
    "</geometry></collision></link></robot>",
}


def with_mesh(cell, folder, name, uri):
    """A scenario with a model that names a mesh."""
    (folder / name).write_text(MODELS[name].format(uri=uri))
    extra = folder / "post.dmd.yaml"
    extra.write_text(f"directives:\n- add_model: {{name: post, file: file://{folder / name}}}\n")
    return dc.replace(cell.scenario, directives=[*cell.scenario.directives, str(extra)])


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("address", ["relative", "file"])
def test_hash_covers_meshes(cell, tmp_path, name, address):
    mesh = tmp_path / "post.obj"
    uri = "post.obj" if address == "relative" else f"file://{mesh}"
    scenario = with_mesh(cell, tmp_path, name, uri)
    hashes = set()
    for size in (0.1, 10.0):
        mesh.write_text(TETRAHEDRON.format(size=size))
        hashes.add(load_cell(scenario).robot_hash)
    assert len(hashes) == 2
    mesh.write_text(TETRAHEDRON.format(size=0.1))
    assert load_cell(scenario).robot_hash in hashes
    mesh.unlink()
    with pytest.raises(InputError, match=r"post\.obj"):
        load_cell(scenario).robot_hash  # noqa: B018


def test_hash_covers_buffers_of_meshes(cell, tmp_path):
    scenario = with_mesh(cell, tmp_path, "post.sdf", "post.gltf")
    (tmp_path / "post.gltf").write_text('{"buffers": [{"uri": "post.bin"}, {"uri": "data:,x"}]}')
    hashes = set()
    for data in (b"1", b"2"):
        (tmp_path / "post.bin").write_bytes(data)
        hashes.add(load_cell(scenario).robot_hash)
    assert len(hashes) == 2
    (tmp_path / "post.gltf").write_text("[")
    with pytest.raises(InputError, match="glTF"):
        load_cell(scenario).robot_hash  # noqa: B018


def test_places_beyond_the_working_table(cell):
    places = [[0.0, -1.2], [0.4, -1.2], [0.0, -0.75], [-0.5, -1.7]]
    assert cell.beyond_table(np.array(places)) == pytest.approx([-0.4, 0.0, 0.05, 0.1])


@pytest.mark.parametrize("key", ["holding_height", "near_table", "sliding_speed", "sinking_speed"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_settings_of_the_tools_that_are_none(cell, key, value):
    tools = dc.replace(cell.scenario.tools, **{key: value})
    with pytest.raises(InputError, match=f"tools {key}"):
        dc.replace(cell.scenario, tools=tools).validate()


@pytest.mark.parametrize(
    ("line", "instead"),
    [
        ("turntable_axis: 0\n", ""),
        ("turntable_axis: 0\n", "turntable_axis: 1\n"),
        ("axes: [7, 8, 9, 10, 11, 12]", "axes: [7, 8, 9, 10, 11]"),
        ("axes: [7, 8, 9, 10, 11, 12]", "axes: [1, 2, 3, 4, 5, 6]"),
        ("gripper: r2_gripper, ", ""),
        ("palm: palm\n", ""),
        ("palm: palm\n", "palm: lower_finger\n"),
        ("fingers: [lower_finger, upper_finger]\n", ""),
        ("- [r1::link_2, turntable::r750]\n", "- [r1::link_2]\n"),
    ],
)
def test_a_robot_without_a_complete_set_of_roles_is_refused(
    tmp_path: Path, line: str, instead: str
) -> None:
    text = model_file("robot.yaml").read_text(encoding="utf-8")
    assert line in text
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace(line, instead), encoding="utf-8")
    with pytest.raises(InputError):
        load_cell(dc.replace(load_scenario(), robot=str(path)))


def test_paths_of_a_scenario_are_beside_it_and_those_of_directives_beside_them(
    cell, tmp_path, monkeypatch
):
    lab, models = tmp_path / "lab", tmp_path / "lab" / "models"
    models.mkdir(parents=True)
    (models / "post.sdf").write_text(
        "<sdf version='1.9'><model name='post'><link name='pole'><collision name='c'><geometry>"
        "<box><size>0.1 0.1 1</size></box></geometry></collision></link></model></sdf>"
    )
    (lab / "post.dmd.yaml").write_text(
        "directives:\n- add_model: {name: post, file: models/post.sdf}\n"
        "- add_weld: {parent: world, child: 'post::pole'}\n"
    )
    file = lab / "lab.scenario.yaml"
    file.write_text(
        "Lab:\n  directives: ['package://unwrinkle_models/cell.dmd.yaml', post.dmd.yaml]\n"
    )
    monkeypatch.chdir(tmp_path)
    mine = load_cell("lab/lab.scenario.yaml")
    assert build_robot_diagram(mine).plant().HasModelInstanceNamed("post")
    before = mine.robot_hash
    assert before != cell.robot_hash
    monkeypatch.chdir(lab)
    assert load_cell(file).robot_hash == before
    post = models / "post.sdf"
    post.write_text(post.read_text().replace("0.1 0.1 1", "0.1 0.1 2"))
    assert load_cell(file).robot_hash != before
