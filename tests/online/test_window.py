"""What the poses before the window say, when the whole map is turned."""

import numpy as np
import pytest

from sngr_utils.online import belief, estimator, window
from sngr_utils.slam import chain_solver, conventions
from sngr_utils.world import scenario, simulation

C = conventions.PRESETS["C"]
FREE = np.array([1.0, 1.0, 1.0])  # m, m, rad: where the map lies in the world is not known


@pytest.fixture(scope="module")
def driven():
    """A belief of twenty poses whose first eight are summed up."""
    drawn = simulation.simulate(
        scenario.Scenario(n_poses=20), 0.0, rng=np.random.default_rng(100)
    ).log(FREE)
    online = estimator.Online(drawn.first(1), C, estimator.Settings(), rng=np.random.default_rng(0))
    for t in range(1, drawn.n_poses):
        online.step(drawn.measurements(t))
    online.belief._leave(8)
    online.belief.solve()
    return online.belief


def cost_when_turned(state: belief.Belief, angle: float) -> float:
    """Cost of the window with all turned about the first pose of the drive, [nats]."""
    start = state.left[0].poses[0, :2]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    places = start + (state.poses[:, :2] - start) @ turn.T
    poses = np.column_stack([places, state.poses[:, 2] + angle])
    landmarks = start + (state.landmarks - start) @ turn.T
    chain = state._chain(state.log, poses, landmarks, state.assignment.used, state.n_left)
    chain = chain._replace(landmark_information=np.zeros(len(landmarks)))
    return window.cost(chain, state.past, chain_solver.state_of(chain, poses, landmarks))


@pytest.mark.parametrize("angle", [-0.2, -0.05, 0.05, 0.2])
def test_the_past_does_not_hold_a_turn_that_it_has_not_seen(driven, angle):
    """The prior asks angle**2 / 2 for it. In coordinates of the world the map would be stretched,
    at a price of several nats."""
    paid = cost_when_turned(driven, angle) - cost_when_turned(driven, 0.0)
    assert paid == pytest.approx(angle**2 / 2, abs=0.05)
