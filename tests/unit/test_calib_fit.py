# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N803, N806  (matrices have the names that docs/calibration.md gives them)
"""The accelerometer fits, against the model they invert and against other ways to the answer."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.core import calib

G = 9.80665
UP = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
CORNERS = np.array(list(itertools.product((1, -1), repeat=3))) / math.sqrt(3.0)
SPREAD = np.concatenate([UP, CORNERS])

S_SKEWED = np.array([[1.012, 0.004, -0.006], [0.009, 0.991, 0.003], [-0.002, 0.007, 1.003]])
B = np.array([0.31, -0.17, 0.22])


def raw(directions, S=S_SKEWED, b=B, g=G):
    return g * directions @ S.T + b


def tilted(directions, angle_deg, seed=0):
    """Each direction turned by exactly this angle about a random axis across it."""
    rng = np.random.default_rng(seed)
    across = np.cross(directions, rng.standard_normal(directions.shape))
    across /= np.linalg.norm(across, axis=1)[:, None]
    angle = math.radians(angle_deg)
    return directions * math.cos(angle) + np.cross(across, directions) * math.sin(angle)


def symmetric_root(A):
    values, vectors = np.linalg.eigh(A)
    return (vectors * np.sqrt(values)) @ vectors.T


def test_closed_form_by_hand():
    """Up reads 9.9, down -9.7: scale 9.8 / g, bias 0.1."""
    means = np.zeros((6, 3))
    means[[0, 1], 0] = 9.9, -9.7
    means[[2, 3], 1] = 10.0, -10.0
    means[[4, 5], 2] = 9.0, -9.4
    fit = calib.fit_faces(means, gravity_mps2=9.8)
    assert fit.status == "converged"
    np.testing.assert_allclose(fit.matrix, np.diag([1.0, 0.98, 9.8 / 9.2]), atol=1e-15)
    np.testing.assert_allclose(fit.bias_mps2, [0.1, 0.0, -0.2], atol=1e-15)


def test_square_faces_are_the_linear_least_squares():
    """Eighteen equations in twelve unknowns, solved as such by another library."""
    rng = np.random.default_rng(3)
    means = raw(UP) + 0.01 * rng.standard_normal((6, 3))
    A = np.hstack([G * UP, np.ones((6, 1))])
    solution = np.linalg.lstsq(A, means, rcond=None)[0]
    fit = calib.fit_faces(means, square=True)
    np.testing.assert_allclose(np.linalg.inv(fit.matrix), solution[:3].T, atol=1e-12)
    np.testing.assert_allclose(fit.bias_mps2, solution[3], atol=1e-12)


def test_square_faces_undo_the_model_exactly():
    fit = calib.fit_faces(raw(UP), square=True)
    np.testing.assert_allclose(fit.matrix @ S_SKEWED, np.eye(3), atol=1e-13)
    np.testing.assert_allclose(fit.bias_mps2, B, atol=1e-13)


def test_tilted_faces_spoil_the_closed_form_and_not_the_magnitudes():
    """1 - cos 3 deg is 0.137 %."""
    S = np.diag([1.012, 0.991, 1.003])
    means = raw(tilted(UP, 3.0), S)
    by_level = np.diag(calib.fit_faces(means).matrix) * np.diag(S) - 1.0
    by_magnitude = calib.fit_magnitude(means, symmetric=False)
    assert by_magnitude.status == "converged"
    assert np.all(by_level > 1.3e-3)
    np.testing.assert_allclose(np.diag(by_magnitude.matrix) * np.diag(S), 1.0, atol=1e-11)
    np.testing.assert_allclose(by_magnitude.bias_mps2, B, atol=1e-10)
    assert np.count_nonzero(by_magnitude.matrix) == 3


def test_symmetric_fit_is_the_symmetric_factor_of_the_inverse():
    """|M S u| = 1 for all u means (M S)^T (M S) = I, so M^2 = (S S^T)^-1."""
    fit = calib.fit_magnitude(raw(tilted(SPREAD, 5.0)))
    assert fit.status == "converged"
    np.testing.assert_allclose(
        fit.matrix, symmetric_root(np.linalg.inv(S_SKEWED @ S_SKEWED.T)), atol=1e-11
    )
    np.testing.assert_allclose(fit.matrix, fit.matrix.T, atol=0)
    np.testing.assert_allclose(fit.bias_mps2, B, atol=1e-10)
    assert np.abs(fit.residuals_mps2).max() < 1e-10
    assert fit.iterations <= 12


def squares(means, parameters, g=G):
    m = parameters
    M = np.array([[m[0], m[6], m[7]], [m[6], m[1], m[8]], [m[7], m[8], m[2]]])
    return np.sum((np.linalg.norm((means - m[3:6]) @ M.T, axis=1) - g) ** 2)


def test_no_point_nearby_is_better():
    """Brute force on noisy poses: a small step along any of many directions costs more."""
    rng = np.random.default_rng(5)
    means = raw(tilted(SPREAD, 5.0)) + 0.02 * rng.standard_normal((14, 3))
    fit = calib.fit_magnitude(means)
    M = fit.matrix
    at = np.array([*np.diag(M), *fit.bias_mps2, M[0, 1], M[0, 2], M[1, 2]])
    least = squares(means, at)
    np.testing.assert_allclose(least, np.sum(fit.residuals_mps2**2), rtol=1e-9)
    assert least > 1e-4
    for step in (1e-2, 1e-4, 1e-5):
        for direction in rng.standard_normal((200, 9)):
            assert squares(means, at + step * direction / np.linalg.norm(direction)) > least


def test_standard_errors_are_the_scatter_of_many_fits():
    rng = np.random.default_rng(6)
    directions, sigma = tilted(SPREAD, 5.0), 0.02
    fits = [
        calib.fit_magnitude(
            raw(directions) + sigma * rng.standard_normal((14, 3)), sigma_mps2=sigma
        )
        for _ in range(600)
    ]
    found = np.std([f.bias_mps2 for f in fits], axis=0)
    found_M = np.std([f.matrix for f in fits], axis=0)
    clean = calib.fit_magnitude(raw(directions), sigma_mps2=sigma)
    np.testing.assert_allclose(clean.bias_sigma_mps2, found, rtol=0.12)
    np.testing.assert_allclose(clean.matrix_sigma, found_M, rtol=0.12)
    np.testing.assert_allclose(
        np.sqrt(np.diag(clean.covariance))[3:6], clean.bias_sigma_mps2, rtol=1e-12
    )


@pytest.mark.parametrize("square", [False, True])
def test_standard_errors_of_the_closed_forms(square):
    rng = np.random.default_rng(7)
    sigma = 0.02
    fits = [
        calib.fit_faces(raw(UP) + sigma * rng.standard_normal((6, 3)), square=square)
        for _ in range(1500)
    ]
    clean = calib.fit_faces(raw(UP), square=square, sigma_mps2=sigma)
    scatter = np.std([f.bias_mps2 for f in fits], axis=0)
    np.testing.assert_allclose(clean.bias_sigma_mps2, scatter, rtol=0.08)
    scatter = np.std([f.matrix for f in fits], axis=0)
    np.testing.assert_allclose(clean.matrix_sigma, scatter, rtol=0.08, atol=1e-12)


def test_residuals_larger_than_expected_enlarge_the_standard_errors():
    rng = np.random.default_rng(8)
    means = raw(SPREAD) + 0.05 * rng.standard_normal((14, 3))
    believed = calib.fit_magnitude(means, sigma_mps2=1.0)
    doubted = calib.fit_magnitude(means, sigma_mps2=1e-6)
    s2 = np.sum(doubted.residuals_mps2**2) / (14 - 9)
    np.testing.assert_allclose(
        doubted.bias_sigma_mps2, believed.bias_sigma_mps2 * math.sqrt(s2), rtol=1e-9
    )


def test_the_symmetric_frame_turns_less_than_the_triangular_one():
    """Rotation left between corrected axes and case, over random skews: 1 to sqrt(2)."""
    rng = np.random.default_rng(9)
    symmetric, triangular = [], []
    for _ in range(400):
        S = np.eye(3) + 0.005 * rng.standard_normal((3, 3))
        inverse = np.linalg.inv(S @ S.T)
        for M, turns in (
            (symmetric_root(inverse), symmetric),
            (np.linalg.cholesky(inverse).T, triangular),
        ):
            R = M @ S
            turns.append(math.degrees(math.acos((np.trace(R) - 1.0) / 2.0)))
    ratio = np.sqrt(np.mean(np.square(triangular)) / np.mean(np.square(symmetric)))
    assert ratio == pytest.approx(math.sqrt(2.0), rel=0.05)


def hemisphere(n=20, seed=1):
    v = np.random.default_rng(seed).standard_normal((n, 3))
    v[:, 2] = np.abs(v[:, 2]) + 1.0
    return v / np.linalg.norm(v, axis=1)[:, None]


def circle(n=12):
    a = 2.0 * np.pi * np.arange(n) / n
    return np.stack([np.cos(a), np.sin(a), np.zeros(n)], axis=1)


@pytest.mark.parametrize(
    "directions",
    [hemisphere(), circle(), np.repeat(UP, 2, axis=0), tilted(np.repeat(UP, 2, axis=0), 5.0)],
    ids=["one side up", "about one axis", "faces twice", "faces twice, tilted"],
)
def test_badly_spread_poses_are_refused(directions):
    fit = calib.fit_magnitude(raw(directions))
    assert fit.status == "poorly_spread"
    assert fit.condition > calib.MAX_CONDITION
    np.testing.assert_array_equal(fit.matrix, np.eye(3))


def test_condition_is_that_of_the_jacobian():
    u = tilted(SPREAD, 5.0)
    x, y, z = u.T
    J = np.stack([x * x, y * y, z * z, -x, -y, -z, 2 * x * y, 2 * x * z, 2 * y * z], axis=1)
    fit = calib.fit_magnitude(G * u)
    assert fit.condition == pytest.approx(np.linalg.cond(J), rel=1e-9)
    assert calib.fit_magnitude(G * UP, symmetric=False).condition == pytest.approx(1.0)


def test_one_condition_limit_keeps_the_standard_error_below_five_means():
    """Sets of nine near the limit: what the limit was chosen for."""
    rng = np.random.default_rng(2)
    worst, seen = 0.0, 0
    for _ in range(4000):
        u = rng.standard_normal((9, 3))
        u /= np.linalg.norm(u, axis=1)[:, None]
        fit = calib.fit_magnitude(G * u, sigma_mps2=1.0)
        if fit.status == "converged":
            seen += 1
            worst = max(worst, fit.bias_sigma_mps2.max(), G * fit.matrix_sigma.max())
    assert seen > 50
    assert 3.0 < worst < 6.0


@pytest.mark.parametrize(("symmetric", "count"), [(False, 5), (True, 8), (True, 0)])
def test_too_few_poses(symmetric, count):
    assert calib.fit_magnitude(raw(SPREAD)[:count], symmetric=symmetric).status == "too_few_poses"


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none(bad):
    means = raw(SPREAD)
    means[2, 1] = bad
    assert calib.fit_magnitude(means).status == "bad_input"
    assert calib.fit_faces(means[:6]).status == "bad_input"
    assert calib.fit_faces(means[:6], square=True).status == "bad_input"


def test_a_dead_sensor_and_no_gravity():
    assert calib.fit_magnitude(np.zeros((9, 3))).status == "bad_input"
    assert calib.fit_faces(np.zeros((6, 3))).status == "poorly_spread"
    assert calib.fit_faces(np.zeros((6, 3)), square=True).status == "poorly_spread"
    for g in (0.0, -9.8, math.nan):
        assert calib.fit_magnitude(raw(SPREAD), gravity_mps2=g).status == "bad_input"
        assert calib.fit_faces(raw(UP), gravity_mps2=g).status == "bad_input"


def test_magnitudes_that_no_ellipsoid_fits_never_pass_for_a_good_fit():
    rng = np.random.default_rng(4)
    means = SPREAD * rng.uniform(0.1, 40.0, (14, 1))
    fit = calib.fit_magnitude(means, sigma_mps2=0.002)
    assert fit.status == "not_converged" or fit.bias_sigma_mps2.max() > 0.5


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="give the six"):
        calib.fit_faces(UP[:5])
    with pytest.raises(ValueError, match=r"give \(n, 3\)"):
        calib.fit_magnitude(np.zeros(9))


small = st.floats(-0.02, 0.02)
chips = st.tuples(
    st.lists(small, min_size=9, max_size=9), st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3)
)


@settings(max_examples=60, deadline=None)
@given(chips, st.integers(0, 1000), st.floats(9.76, 9.84))
def test_law_the_correction_undoes_the_model_up_to_a_turn(chip, seed, g):
    S, b = np.eye(3) + np.reshape(chip[0], (3, 3)), np.array(chip[1])
    fit = calib.fit_magnitude(raw(tilted(SPREAD, 8.0, seed), S, b, g), gravity_mps2=g)
    assert fit.status == "converged"
    R = fit.matrix @ S
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(fit.bias_mps2, b, atol=1e-8)


@settings(max_examples=40, deadline=None)
@given(chips, st.permutations(range(14)))
def test_law_the_order_of_poses_changes_nothing(chip, order):
    """To the step at which rounding of the sum ends the iteration, 1e-9 in g-units."""
    S, b = np.eye(3) + np.reshape(chip[0], (3, 3)), np.array(chip[1])
    noise = 0.01 * np.random.default_rng(0).standard_normal((14, 3))
    means = raw(SPREAD, S, b) + noise
    one, other = calib.fit_magnitude(means), calib.fit_magnitude(means[list(order)])
    np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-9)
    np.testing.assert_allclose(one.bias_mps2, other.bias_mps2, atol=1e-8)
    np.testing.assert_allclose(one.residuals_mps2[list(order)], other.residuals_mps2, atol=1e-8)


@settings(max_examples=40, deadline=None)
@given(chips, st.floats(0.5, 2.0))
def test_law_gravity_only_scales(chip, factor):
    """Twice the gravity in all means, and twice in the argument: the same M, twice the b."""
    S, b = np.eye(3) + np.reshape(chip[0], (3, 3)), np.array(chip[1])
    means = raw(SPREAD, S, b)
    one = calib.fit_magnitude(means)
    other = calib.fit_magnitude(factor * means, gravity_mps2=factor * G)
    np.testing.assert_allclose(other.matrix, one.matrix, atol=1e-10)
    np.testing.assert_allclose(other.bias_mps2, factor * one.bias_mps2, atol=1e-9)
