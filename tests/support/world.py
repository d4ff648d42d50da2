"""The world of the study with other constants."""

from velocal.paper.tuning import with_values
from velocal.simulation.world import World, load
from velocal.study.world import Errors

#: Factor of the surveyor's errors in a world without errors; zero would make them singular.
TINY = 1e-6
#: Errors of parameters, which stay in a world without errors, and lengths, which are no errors.
PARAMETERS = ("dl_mean_cm", "dl_cm", "alpha_deg", "v_deg")
LENGTHS = ("dl_limit", "pattern_kernel_deg", "far_point_m", "noise_range_m")


def changed(world: World, values: dict[str, object]) -> World:
    """The world with other constants at paths as `scanners/HDL-64E/errors/dl_cm`."""
    return load(with_values(world.plain(), {"tuned": [], **values}))


def without_errors(world: World) -> World:
    """World with the same parameters, but perfect shots and a perfect survey.

    Ticks of the distance and steps of the encoder remain, as they belong to the packets.
    """
    values: dict[str, object] = {}
    for name, unit in world.scanners.items():
        place = f"scanners/{name}"
        values[f"{place}/dropout"] = 0.0
        values[f"{place}/base_scanner/std_mm"] = [TINY * s for s in unit.base_scanner.std_mm]
        values[f"{place}/base_pointing_mm"] = TINY * unit.base_pointing_mm
        for error in Errors.model_fields:
            if error not in (*PARAMETERS, *LENGTHS):
                values[f"{place}/errors/{error}"] = {} if error == "shift_mean_cm" else 0.0
    for surface, _ in world.site.flatness:
        values[f"field/flatness/{surface}"] = {"mean_mm": 0.0, "max_mm": 0.0}
    for name, std in world.survey.total_station:
        values[f"survey/total_station/{name}"] = TINY * std
    values["survey/camera/image_um"] = TINY * world.survey.camera.image_um
    return changed(world, values)
