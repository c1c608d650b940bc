"""Collision model: clearances, steps that nothing slips through, and the bound behind them."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.geometry import Role

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import build_robot_diagram, load_cell, position_indices
from unwrinkle.planning.robot.axis_reach import axis_reach
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.verification.model import CellModel


@pytest.fixture(scope="module")
def contact(cell):
    return CollisionModel(cell, contact=True)


@pytest.fixture(scope="module")
def transit(cell):
    return CollisionModel(cell, contact=False)


def touching(kinematics, height: float):
    """Both arms with their lower blades at a height above the table, tilted by 45 degrees."""
    from unwrinkle.planning.search.key_poses import tool_poses, tool_rotation

    q = np.zeros(13)
    for arm, x in ((0, -0.22), (1, 0.22)):
        rotation = tool_rotation(np.array([-np.sign(x), 0.0]), np.radians(45))
        X_WT = tool_poses(np.array([[x, -1.10, 0.70 + height]]), rotation)
        solution = kinematics.inverse(arm, 0.0, X_WT)
        q[1 + 6 * arm : 7 + 6 * arm] = solution.q[0][solution.within[0]][0]
    return q


def test_named_states_are_free(cell, contact, transit):
    for q in cell.robot.named_states.values():
        assert contact.free(np.array(q)) and transit.free(np.array(q))


def test_fingers_may_touch_the_table_only_where_allowed(kinematics, contact, transit):
    near = touching(kinematics, 0.003)
    assert contact.free(near)
    assert not transit.free(near)
    assert "finger" in "".join(transit.colliding_pair(near)) and "t2" in "".join(
        transit.colliding_pair(near)
    )
    below = touching(kinematics, -0.002)
    assert not contact.free(below)
    assert transit.free(touching(kinematics, 0.012))


def test_hands_keep_apart(kinematics, contact):
    q = touching(kinematics, 0.05)
    mirrored = q.copy()
    mirrored[1:7] = [0.4, 0.5, 0.0, 0.0, 0.0, 0.0]
    mirrored[7:13] = [-0.4, 0.5, 0.0, 0.0, 0.0, 0.0]
    assert contact.free(q)
    assert not contact.free(mirrored)
    pair = contact.colliding_pair(mirrored)
    assert {name[:2] for name in pair} == {"r1", "r2"}


def test_an_obstacle_from_directives_is_seen(cell, tmp_path, kinematics):
    box = tmp_path / "post.sdf"
    box.write_text(
        "<sdf version='1.9'><model name='post'><link name='post'><collision name='c'><geometry>"
        "<box><size>0.02 0.02 1.5</size></box></geometry></collision></link></model></sdf>"
    )
    extra = tmp_path / "post.dmd.yaml"
    extra.write_text(
        f"directives:\n- add_model: {{name: post, file: file://{box}}}\n"
        "- add_weld: {parent: world, child: post::post, X_PC: {translation: [0.3, -1.0, 0.75]}}\n"
    )
    directives = [*cell.scenario.directives, str(extra)]
    model = CollisionModel(
        load_cell(dc.replace(cell.scenario, directives=directives)), contact=True
    )
    start, goal = touching(kinematics, 0.12), np.zeros(13)
    assert CollisionModel(cell, contact=True).edge_free(start, goal)
    swung = goal.copy()
    swung[0] = 0.9
    path_hits = not model.edge_free(start, start + (swung - goal))
    assert path_hits  # a post 2 cm thick is not stepped over


def with_roles(cell, **changes):
    """The cell with other roles in its robot's description."""
    return dc.replace(cell, robot=dc.replace(cell.robot, **changes))


@pytest.mark.parametrize(
    "changes",
    [
        {"palm": "plam"},
        {"fingers": ["lower_finger", "uper_finger"]},
        {"adjacent": [["r1::link_2", "turntable::r751"]]},
    ],
)
@pytest.mark.parametrize("model", [lambda cell: CollisionModel(cell, contact=True), CellModel])
def test_a_role_of_a_link_that_is_not_there_is_refused(cell, model, changes):
    with pytest.raises(InputError):
        model(with_roles(cell, **changes))


@pytest.mark.parametrize(
    "pair",
    [
        ["r1_gripper::palm", "t2::desk"],
        ["r1::link_4", "r2::link_4"],
        ["turntable::r750", "t2::desk"],
        ["r1::link_3", "turntable::r750"],
    ],
)
def test_the_verification_exempts_neighbours_only(cell, pair):
    with pytest.raises(InputError):
        CellModel(with_roles(cell, adjacent=[*cell.robot.adjacent, pair]))


def test_only_an_exempt_pair_has_no_required_clearance(cell):
    def required(model, *names):
        return next(pair.required for pair in model.pairs if set(pair.names) == set(names))

    shoulder = ("r1::link_2", "turntable::r750")
    assert required(CellModel(cell), *shoulder) == 0.0
    strict = CellModel(with_roles(cell, adjacent=[]))
    assert required(strict, *shoulder) == cell.scenario.clearance.surroundings


def test_reach_of_the_shipped_robot(cell):
    arm = [2.01855629, 1.86855629, 1.25455629, 0.58403410, 0.58403410, 0.08656854]
    assert axis_reach(cell) == pytest.approx([2.39132494, *arm, *arm], abs=1e-8)


def test_reach_bounds_the_motion_of_every_point(cell):
    """No point of a collision shape moves by more than the bound says, per axis, from random
    configurations.
    """
    reach = axis_reach(cell)
    diagram = build_robot_diagram(cell)
    plant, scene_graph = diagram.plant(), diagram.scene_graph()
    inspector = scene_graph.model_inspector()
    context = plant.CreateDefaultContext()
    axes = position_indices(cell, plant).axes
    points = []
    for instance in ("r1", "r1_gripper", "r2", "r2_gripper"):
        for index in plant.GetBodyIndices(plant.GetModelInstanceByName(instance)):
            body = plant.get_body(index)
            frame = plant.GetBodyFrameIdOrThrow(index)
            for geometry in inspector.GetGeometries(frame, Role.kProximity):
                shape, X_BG = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry)
                half = (
                    0.5 * np.array(shape.size())
                    if hasattr(shape, "size")
                    else np.array([shape.radius(), shape.radius(), 0.5 * shape.length()])
                )
                corners = half * np.array(np.meshgrid(*3 * [[-1, 1]])).reshape(3, -1).T
                if not hasattr(shape, "size"):
                    corners[:, :2] /= np.sqrt(2.0)
                points.append((body.body_frame(), (X_BG @ corners.T).T))
    rng = np.random.default_rng(6)
    q = plant.GetPositions(context)
    worst = np.zeros(13)
    for _ in range(60):
        x = rng.uniform(cell.limits.lower, cell.limits.upper)
        for axis in range(13):
            moved = []
            for delta in (0.0, 1e-6):
                y = x.copy()
                y[axis] += delta
                q[axes] = y
                plant.SetPositions(context, q)
                moved.append(
                    np.concatenate([(f.CalcPoseInWorld(context) @ p.T).T for f, p in points])
                )
            worst[axis] = max(worst[axis], np.linalg.norm(moved[1] - moved[0], axis=1).max() / 1e-6)
    assert np.all(worst <= reach + 1e-6)
    assert np.all(worst > 0.3 * reach)  # and is no idle exaggeration


def test_a_model_with_another_contact_is_as_if_built_so(cell, kinematics, contact, transit):
    other = contact.with_contact(False)
    near = touching(kinematics, 0.003)
    assert contact.free(near) and not other.free(near)
    assert other.with_contact(True).free(near)
    rng = np.random.default_rng(5)
    for q in rng.uniform(0.6 * cell.limits.lower, 0.6 * cell.limits.upper, (40, 13)):
        assert other.free(q) == transit.free(q)
        assert other.colliding_pair(q) == transit.colliding_pair(q)
