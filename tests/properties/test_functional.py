"""Functional model: residual and derivatives against independent forms."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from velocal.adjustment.functional import ADJUSTABLE, design, misclosure
from velocal.paper.residual_form import beta, paper_form
from velocal.scanner.beam import points
from velocal.scanner.parameters import PARAMETERS, LaserParameters

angle = st.floats(-np.pi, np.pi)
CASES = st.fixed_dictionaries(
    {
        "l": st.floats(0.5, 100.0),
        "phi": st.floats(0.0, 2 * np.pi),
        "dl": st.floats(-0.2, 2.0),
        "alpha": st.floats(-0.3, 0.3),
        "v": st.floats(-0.55, 0.3),
        "voff": st.floats(-0.1, 0.3),
        "hoff": st.floats(-0.05, 0.05),
    }
)
normals = st.tuples(angle, st.floats(-1.5, 1.5))


def unit(direction):
    heading, up = direction
    return np.array([np.cos(up) * np.sin(heading), np.cos(up) * np.cos(heading), np.sin(up)])


def s_of(case, normal, offset, dtype=float):
    """Literal s, written again without the library and good for complex arguments."""
    theta = case["phi"] - case["alpha"]
    u = np.array(
        [np.cos(case["v"]) * np.sin(theta), np.cos(case["v"]) * np.cos(theta), np.sin(case["v"])],
        dtype=dtype,
    )
    o = np.array(
        [-case["hoff"] * np.cos(theta), case["hoff"] * np.sin(theta), case["voff"]], dtype=dtype
    )
    x = (case["l"] * (1.0 + case.get("scale", 0.0)) + case["dl"]) * u + o
    return (normal @ x + offset) / (normal @ u)


def arrays(case):
    one = {name: np.array([case[name]]) for name in PARAMETERS}
    return np.array([case["l"]]), np.array([case["phi"]]), np.array([0]), LaserParameters(**one)


@settings(max_examples=3000)
@given(CASES, normals, st.floats(-30.0, 30.0))
def test_jacobian_is_the_complex_step(case, direction, offset):
    normal = unit(direction)
    u = s_of({**case, "l": 1.0, "dl": 0.0, "hoff": 0.0, "voff": 0.0}, normal, 0.0)
    assume(abs(u) > 0)
    l, phi, laser, parameters = arrays(case)  # noqa: E741
    g = normal @ points(np.ones(1), phi, laser, LaserParameters(
        *(np.zeros(1) if n in ("dl", "voff", "hoff") else getattr(parameters, n)
          for n in PARAMETERS)))[0]  # fmt: skip
    assume(abs(g) > 0.02)
    s, matrix = design(l, phi, laser, parameters, normal[None], np.array([offset]))
    np.testing.assert_allclose(s[0], s_of(case, normal, offset), rtol=1e-10, atol=1e-12)
    # The observations too: by phi the derivative is minus that by alpha, by l that by dl.
    own = {name: matrix[0, column] for column, name in enumerate(ADJUSTABLE)}
    own |= {"phi": -own["alpha"], "l": own["dl"]}
    for name, found in own.items():
        stepped = s_of({**case, name: case.get(name, 0.0) + 1e-30j}, normal, offset, complex)
        exact = stepped.imag / 1e-30
        # Cancellation in n.u makes everything relative to 1 / |n.u|.
        size = max(abs(exact), abs(s[0]), 1.0) / abs(g)
        assert abs(found - exact) <= 1e-10 * size, name


@given(CASES, normals, st.floats(-30.0, 30.0))
def test_the_corrected_point_lies_on_the_plane(case, direction, offset):
    normal = unit(direction)
    l, phi, laser, parameters = arrays(case)  # noqa: E741
    s = misclosure(l, phi, laser, parameters, normal[None], np.array([offset]))
    assume(np.isfinite(s[0]) and abs(s[0]) < 1e3)
    on_plane = points(l - s, phi, laser, parameters)
    assert abs(normal @ on_plane[0] + offset) < 1e-9


@given(CASES, st.floats(0.0, np.pi, exclude_max=True), st.floats(0.5, 20.0), st.booleans())
def test_paper_form_is_the_general_form_on_vertical_walls(case, omega, distance, side):
    """Equation (5) with beta of Table I; omega is the angle of the wall's trace with Y."""
    normal = np.array([np.cos(omega), -np.sin(omega), 0.0]) * (1 if side else -1)
    l, phi, laser, parameters = arrays(case)  # noqa: E741
    sine = np.abs(np.sin(phi - parameters.alpha - omega))
    assume(sine[0] > 0.05)
    b = beta(phi, parameters.alpha, np.array([omega]))
    np.testing.assert_allclose(np.abs(np.sin(b)), sine, rtol=1e-9)
    xyz = points(l, phi, laser, parameters)
    printed = paper_form(xyz, normal / -distance, parameters.v, b)
    general = misclosure(l, phi, laser, parameters, normal[None], np.array([-distance]))
    np.testing.assert_allclose(np.abs(printed), np.abs(general), rtol=1e-8, atol=1e-10)
