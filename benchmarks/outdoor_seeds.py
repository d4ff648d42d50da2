"""Outdoor validation over seeds of the simulated world, without packets and files.

The outdoor constants of config/world.yaml were tuned with it. Returns are drawn on the panels
alone; parameter sets come from exact planes and medians without noise. Fog and people are left
out, as they only take returns away.

Usage: python benchmarks/outdoor_seeds.py [seeds [file]]   (default 10; the first is the study's)

With a file, every sample of every seed is written to it. `src/velocal/paper/data/outdoor_seeds.csv`
was made in this way with 12 seeds; the claims of the paper on outdoor distances are judged by it.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations
from velocal.evaluation.candidates import with_sets
from velocal.evaluation.panels import Panels, fit_panels, panel_rows
from velocal.evaluation.planes_in_data import Cloud, PlaneLimits
from velocal.paper.outdoor import before_and_after, summarise
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, SCANNERS
from velocal.simulation import truth, world
from velocal.simulation.outdoor import outdoor_scene
from velocal.simulation.scene import Scene, cast, site_scene
from velocal.study.reading import read_yaml
from velocal.study.study import read_study

PLANES = 3
ROTATIONS = 8
COLUMNS = ["kind", "scanner", "sample", "distance_m", "before_cm", "after_cm"]


def shots(simulated, scanner, scene: Scene, ticks):
    """Length, raw distance without noise, and first surface of all lasers at raw azimuths."""
    true = truth.unit_truth(simulated, scanner)
    lasers = np.repeat(np.arange(len(true.noise_m)), len(ticks))
    at = np.tile(ticks, len(true.noise_m))
    phi = np.deg2rad(at * AZIMUTH_TICK_DEG)
    direction, origin = laser_beams(phi, lasers, true.parameters)
    length, surface = cast(
        scene.surfaces, scene.pose.apply(origin), direction @ scene.pose.rotation.T
    )
    raw = true.raw(length, lasers) + scene.errors[at, lasers]
    return phi, lasers, length, raw, surface


def mean_drift(simulated, scanner, sample):
    """Mean drift of all lasers over a recording, metres."""
    times = simulated.represented_s(np.linspace(0.0, 1.0, 30, endpoint=False), 1.0)
    return truth.drift(simulated, scanner, sample).at(times).mean(axis=0)


def adjusted(simulated, scanner, position, sample, adjustment):
    """Corrections of one sample on the surveyed field."""
    scene = site_scene(simulated, scanner, position)
    phi, lasers, _, raw, surface = shots(simulated, scanner, scene, np.arange(0, AZIMUTH_TICKS, 27))
    hit = (surface >= 0) & (surface < PLANES)
    raw = raw + mean_drift(simulated, scanner, sample)[lasers]
    planes = list(scene.surfaces.values())[:PLANES]
    inverse = scene.pose.inverse()
    normal = np.array([-plane.normal @ scene.pose.rotation for plane in planes])
    offset = np.array(
        [-n @ inverse.apply(plane.corner) for n, plane in zip(normal, planes, strict=True)]
    )
    s = surface[hit]
    seen = Observations(raw[hit], phi[hit], lasers[hit], normal[s], offset[s], s)
    names = adjustment.parameters
    factory = truth.factory_parameters(simulated, scanner)
    # Only the corrections are of interest here: what covariances need is left out.
    plain = replace(adjustment.stochastic(), block_rad=None, repeatability_m=0.0)
    results = adjust_all(seen, factory, names, adjustment.solver(), plain)
    return dict(zip(names, np.array([r.corrections for r in results]).T, strict=True))


def parameter_sets(simulated, scanner, study):
    """Candidates: the factory's values, and parameter sets as the study forms them."""
    factory = truth.factory_parameters(simulated, scanner)
    sets = study.parameter_sets[scanner]
    single = {
        name: adjusted(
            simulated, scanner, study.surveyed[name].position, name, study.adjustment(scanner)
        )
        for name in dict.fromkeys(sample for samples in sets.values() for sample in samples)
    }
    averages = {
        name: factory.corrected(
            {key: np.mean([single[s][key] for s in samples], axis=0) for key in single[samples[0]]}
        )
        for name, samples in sets.items()
    }
    return with_sets(factory, averages)


def sample(simulated, row, candidates, section):
    """Rows of the panels of one outdoor sample."""
    scanner = SCANNERS[row.scanner]
    scene = outdoor_scene(simulated, scanner.name, row.scene, 1.0)
    middle, half = simulated.outdoor.azimuth_deg, np.rad2deg(2.5 / row.distance_m)
    rng = simulated.rng("tuning", row.name)
    # All lasers are off by up to ten degrees: the sector is wide enough for each.
    step = scanner.firing_cycle_s * 3600.0 / AZIMUTH_TICK_DEG
    sector = np.arange(middle - half - 12.0, middle + half + 12.0, step * AZIMUTH_TICK_DEG)
    ticks = np.rint(np.concatenate([sector + rng.uniform(0, 1) for _ in range(ROTATIONS)]) / 0.01)
    ticks = ticks.astype(int) % AZIMUTH_TICKS
    phi, lasers, length, raw, surface = shots(simulated, scanner.name, scene, ticks)
    hit = surface > 0
    phi, lasers, length, raw = phi[hit], lasers[hit], length[hit], raw[hit]
    drift = mean_drift(simulated, scanner.name, row.name)
    noise = truth.unit_truth(simulated, scanner.name).noise(length, lasers)
    noise *= np.hypot(1.0, simulated.outdoor.kinds[row.kind].fog.noise)
    raw = raw + drift[lasers] + noise * rng.standard_normal(len(raw))
    beams = Beams(raw, phi, lasers, scanner.distance_tick_m)
    cloud = Cloud.from_beams(beams, candidates[0].parameters)
    panels = Panels(
        row.distance_m, np.deg2rad(row.azimuth_deg), section.panels, section.fit.depth_m
    )
    planes = fit_panels(cloud, panels, PlaneLimits.from_fit(section.fit), row.name)
    heading = {"kind": row.kind, "scanner": row.scanner, "sample": row.name}
    return [heading | each for each in panel_rows(cloud, planes, candidates)]


def study(seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """All samples and the means of a seed; the study's own seed if it is zero."""
    chosen = read_study(read_yaml(Path("config/config.yaml")), "config/config.yaml")
    simulated = world.read(Path(chosen.config.simulation.world))
    simulated = simulated.model_copy(update={"seed": simulated.seed + seed})
    candidates = {name: parameter_sets(simulated, name, chosen) for name in simulated.scanners}
    panels = [
        panel
        for row in chosen.outdoor.values()
        for panel in sample(simulated, row, candidates[row.scanner], chosen.config.outdoor)
    ]
    samples, means = summarise(pd.DataFrame(panels))
    shown = before_and_after(means, ["kind", "scanner"])
    return before_and_after(samples, ["sample"]), shown.assign(seed=simulated.seed)


def main(seeds: int, file: str | None = None) -> None:
    """Print the samples of the study's seed, the means of every seed, and their mean."""
    every, of_seeds = [], []
    for seed in range(seeds):
        samples, means = study(seed)
        of_seeds.append(samples[COLUMNS].assign(seed=means["seed"].iloc[0]))
        if not seed:
            print(samples.drop(columns=["points", "trimmed"]).round(2).to_string(index=False))
        every.append(means)
    if file:
        pd.concat(of_seeds).to_csv(file, index=False, float_format="%.4f", lineterminator="\n")
    table = pd.concat(every)
    shown = ["before_cm", "after_cm"]
    print(table.pivot(index="seed", columns=["kind", "scanner"], values=shown).round(2).to_string())
    print(table.groupby(["kind", "scanner"])[shown].agg(["mean", "std"]).round(2).to_string())


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10, *sys.argv[2:3])
