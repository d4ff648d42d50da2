"""The simulated survey: the printed accuracies come out, and the truth lies within them."""

import numpy as np
import pytest
from support.chain import study_world
from support.world import changed

from velocal.geometry.rigid import RigidTransformation, adjust_rigid, closed_form
from velocal.simulation import survey
from velocal.survey.network.survey import Survey, accuracy, adjust_field_book

#: Largest mean square errors of a coordinate that the paper states, mm.
PRINTED = {"control_points": 0.89, "targets": 0.93, "base_field": 0.97, "base_scanner": 0.68}
SEEDS = range(8)


def numbers(world, **how) -> dict[str, float]:
    found = accuracy(adjust_field_book(survey.field_book(world), **how))
    return dict(zip(found["item"], found["value_mm"], strict=True))


def pose_at(surveyed: Survey, scanner: str, position: str) -> RigidTransformation:
    """`T_field_scanner` with its covariance."""
    field, own = surveyed.base_site[position], surveyed.base_scanner[scanner].targets
    adjusted = adjust_rigid(field.xyz, own.xyz, field.covariance(), own.covariance())
    return adjusted.transformation.inverse()


def test_printed_accuracies_are_results():
    found = numbers(study_world())
    print(found)
    assert found == {name: pytest.approx(value, rel=0.15) for name, value in PRINTED.items()}


def test_accuracies_follow_from_the_observations():
    world = study_world()
    reference = numbers(world, a_priori=True)

    def doubled(place, value):
        return numbers(changed(world, {f"survey/{place}": 2 * value}), a_priori=True)

    coarse = doubled("total_station/pointing_mm", world.survey.total_station.pointing_mm)
    assert 1.4 < coarse["control_points"] / reference["control_points"] < 2.0
    assert coarse["base_scanner"] == reference["base_scanner"]
    blurred = doubled("camera/image_um", world.survey.camera.image_um)
    assert blurred["control_points"] == reference["control_points"]
    assert 1.3 < blurred["targets"] / reference["targets"] < 2.0
    rough = changed(world, {"scanners/HDL-64E/base_scanner/std_mm": [3.0, 1.0, 1.0]})
    assert numbers(rough)["base_scanner"] == pytest.approx(2 * numbers(world)["base_scanner"])


@pytest.mark.slow
def test_truth_lies_within_the_stated_accuracy():
    """In the datum, as the frame of a free network is that of the approximate coordinates."""
    inside: dict[str, list[float]] = {"control": [], "targets": [], "base": []}
    square = {"HDL-64E": [], "HDL-32E": []}
    for seed in SEEDS:
        world = changed(study_world(), {"seed": seed})
        book = survey.field_book(world)
        found = adjust_field_book(book)
        control = survey.true_targets(world, world.survey.control, "control").xyz
        targets = survey.true_targets(world, world.site.targets, "targets").xyz
        frame = in_datum(control, book.control.xyz)
        for name, adjusted, true in (
            ("control", found.control_points, control),
            ("targets", found.planes, targets),
        ):
            inside[name].append(np.mean(np.abs(adjusted.xyz - frame(true)) < 1.96 * adjusted.std))
        for position, base in found.base_site.items():
            scanner = world.positions[position].scanner
            true = world.pose(position)
            field = frame(true.apply(survey.base_targets_true(world, scanner).xyz))
            inside["base"].append(np.mean(np.abs(base.xyz - field) < 1.96 * base.std))
            pose = pose_at(found, scanner, position)
            rotation, place = closed_form(survey.base_targets_true(world, scanner).xyz, field)
            turn = pose.rotation @ rotation.T
            small = 0.5 * np.array(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
            )
            error = np.concatenate([small, pose.translation - place])
            square[scanner].append(error @ np.linalg.solve(pose.covariance, error) / 6.0)
    print({name: np.mean(shares) for name, shares in inside.items()}, square)
    for name, shares in inside.items():
        # Coordinates of a survey are correlated: its scatter from seed to seed tells the margin.
        margin = 4.0 * max(np.std(shares), 0.03) / np.sqrt(len(shares))
        assert np.mean(shares) == pytest.approx(0.95, abs=margin), name
    for scanner, values in square.items():
        # Mean of chi-square with six freedoms over its freedoms; caliper: few repetitions.
        assert np.mean(values) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 6 / len(values))), (
            scanner
        )


def in_datum(true, approximate):
    """Shift and turn about the plumb line that bring true points to the approximate ones."""
    middle, centre = true.mean(axis=0), approximate.mean(axis=0)
    flat, wanted = ((p[:, 0] + 1j * p[:, 1]) for p in (true - middle, approximate - centre))
    angle = np.angle(np.sum(wanted * flat.conj()))
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    return lambda xyz: (xyz - middle) @ turn.T + centre


@pytest.mark.parametrize(
    ("scanner", "metres", "degrees"), [("HDL-64E", 0.5e-3, 0.04), ("HDL-32E", 0.3e-3, 0.01)]
)
def test_pose_is_as_good_as_the_tables_demand(scanner, metres, degrees):
    """Errors of the poses that the tables leave room for (docs/simulated-world.md)."""
    world = study_world()
    found = adjust_field_book(survey.field_book(world, noise=False), a_priori=True)
    for position, where in world.positions.items():
        if where.scanner == scanner:
            variance = np.diag(pose_at(found, scanner, position).covariance)
            assert np.sqrt(variance[3:].mean()) == pytest.approx(metres, rel=0.3)
            assert np.rad2deg(np.sqrt(variance[:3].mean())) == pytest.approx(degrees, rel=0.3)
