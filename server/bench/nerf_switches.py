"""``dronerf bench nerf --ablations``: what each switch of the field's training is worth.

The bench's own pictures, many and few, trained for the same number of steps with one switch put
back at a time; PSNR of held-out views. A switch that costs is a switch to take away.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np

from server.bench.nerf_pictures import FEW_VIEWS, HELD_OUT_VIEWS, TRAINING_VIEWS, bench_dataset
from server.nerf.config import FieldConfig, TrainConfig, suited_configs
from server.nerf.dataset import Dataset
from server.nerf.training import Trainer

_STEPS = 1500
_JUDGED_VIEWS = 10

# By name: what is put back in the field's shape, and what in its training.
_SWITCHES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "nothing": ({}, {}),
    "all levels at once": ({}, {"window_until": TrainConfig().window_until}),
    "no distortion loss": ({}, {"distortion_weight": TrainConfig().distortion_weight}),
    "little pull near cameras": ({}, {"trust_distance": 0.0}),
    "proposals from memory": ({}, {"even_share": 1.0, "even_share_end": 1.0}),
    "half of the samples even": (
        {},
        {"even_share": TrainConfig().even_share, "even_share_end": TrainConfig().even_share_end},
    ),
    "slow MLPs": ({}, {"mlp_rate_share": 1.0}),
    "decay of the MLPs": ({}, {"mlp_weight_decay": 0.0}),
    "exposure gains": ({}, {"exposure_rate": 0.0}),
    "view directions": ({"sh_degree": 1}, {}),
    "small tables": ({"log2_table_size": 17}, {}),
}
_MASKS = "transparency"


def switches(scene: str, seed: int, threads: int) -> dict[str, Any]:
    """Return ``{without: {psnr_db, psnr_db_8_views}}`` of one scene."""
    dataset = bench_dataset(scene)
    opaque = replace(dataset, alphas=(None,) * len(dataset))
    field, train = suited_configs(cut_out=True)
    found: dict[str, dict[str, float]] = {}
    for name, (of_field, of_training) in _SWITCHES.items():
        changed = replace(field, **of_field), replace(train, **of_training)
        found[name] = _psnr(dataset, *changed, seed, threads)
        _tell(name, found[name])
    # White is then a colour like others, and nothing says where the object cannot be.
    found[_MASKS] = _psnr(opaque, field, train, seed, threads)
    _tell(_MASKS, found[_MASKS])
    return {"without": found}


def _tell(name: str, found: dict[str, float]) -> None:
    """Tell whoever waits how far it is: all switches of a scene take a quarter of an hour."""
    print(f"  without {name}: {found}", file=sys.stderr, flush=True)


def _psnr(
    dataset: Dataset, field: FieldConfig, train: TrainConfig, seed: int, threads: int
) -> dict[str, float]:
    judged = [TRAINING_VIEWS + i * HELD_OUT_VIEWS // _JUDGED_VIEWS for i in range(_JUDGED_VIEWS)]
    few = {index * TRAINING_VIEWS // FEW_VIEWS for index in range(FEW_VIEWS)}
    every = range(len(dataset))
    unseen = {
        "psnr_db": [index for index in every if index >= TRAINING_VIEWS],
        "psnr_db_8_views": [index for index in every if index not in few],
    }
    found = {}
    for key, held_out in unseen.items():
        trainer = Trainer(dataset, field, train, held_out=held_out, seed=seed, threads=threads)
        trainer.run(steps=_STEPS)
        found[key] = round(trainer.evaluate(judged).metrics.psnr_db, 3)
    return found


def mean_switches(parts: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the means over scenes, and beside each what the switch gains."""
    names = next(iter(parts.values()))["without"]
    keys = next(iter(names.values()))
    means = {
        name: {
            key: float(np.mean([part["without"][name][key] for part in parts.values()]))
            for key in keys
        }
        for name in names
    }
    return {
        name: {key: round(value, 3) for key, value in mean.items()}
        | {f"gain_{key}": round(means["nothing"][key] - mean[key], 3) for key in keys}
        for name, mean in means.items()
    }
