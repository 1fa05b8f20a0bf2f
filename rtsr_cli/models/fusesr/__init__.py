"""`fusesr`, `fusesr-fast`, `fusesr-direct`: super-resolution by an H-shaped network.

Zhong et al., "FuseSR: Super Resolution for Real-time Rendering through Efficient Multi-resolution
Fusion", SIGGRAPH Asia 2023. HR material buffers are pixel-unshuffled to LR, where they meet the
features of LR lighting; the result is shuffled back and multiplied by the HR material. The fast
network leaves history out; the direct one predicts radiance without demodulation.

Conventions: those of `lighting.lighting` and `inputs`.

Departs from the publication in the preset `rtsr`: the network sees and predicts log(1 + L/k), k of
the whole frame; depth is 1 / (1 + metres); its output is added to an enlargement of the lighting
along HR surfaces before the last layer; warps are pixel-centred, motion to t-2 is chained in order,
history depth is warped; emission is added and sky enlarged on its own. `paper` keeps the published
choices around the same layers: raw lighting over softplus(F), depth as stored, no such sum.
"""

from __future__ import annotations

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.lighting.lighting import (
    GUIDES,
    HR_BUFFERS,
    HR_OPTIONAL,
    LR_BUFFERS,
    LR_OPTIONAL,
    REFERENCE_BUFFERS,
    compose_lighting,
)
from rtsr_cli.core.system import (
    FrameWindow,
    Prediction,
    System,
    Tensors,
    TrainingRecipe,
    neural_predict,
)
from rtsr_cli.models.fusesr.config import (
    HISTORY_FRAMES,
    FuseSRConfig,
    FuseSRDirectConfig,
    FuseSRFastConfig,
)
from rtsr_cli.models.fusesr.graphs import describe_fast, describe_full
from rtsr_cli.models.fusesr.inputs import derivation, prepare, surroundings_of
from rtsr_cli.models.fusesr.loss import goal, loss
from rtsr_cli.models.fusesr.network import FuseSRFastNetwork, FuseSRNetwork

FAST_HALO_PX = 17
"""LR pixels that an output of the fast network reaches to: 14 layers at LR, one HR, and `base`."""


def compose(
    config: FuseSRConfig, window: FrameWindow, inputs: Tensors, outputs: Tensors
) -> Prediction:
    """Radiance from predicted lighting."""
    return compose_lighting(surroundings_of(config), window, inputs, outputs["predicted"])


LEARNING = TrainingRecipe(prepare=prepare, reference=REFERENCE_BUFFERS, goal=goal, loss=loss)

CITATION = "Zhong et al., FuseSR, SIGGRAPH Asia 2023"

FUSESR = System(
    name="fusesr",
    summary="H-shaped network over lighting, HR G-buffer and two past frames",
    citation=CITATION,
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION),
    lr_optional=LR_OPTIONAL,
    hr_inputs=(*HR_BUFFERS, Buffer.DEPTH, Buffer.NORMAL, Buffer.ALBEDO),
    hr_optional=HR_OPTIONAL,
    scales=(4, 8),
    history_frames=HISTORY_FRAMES,
    halo_px=None,
    derivation=derivation,
    config=FuseSRConfig,
    variants={v.value: FuseSRConfig(variant=v) for v in FuseSRConfig.variants},
    build=FuseSRNetwork,
    predict=neural_predict(prepare, compose),
    learning=LEARNING,
    graphs=describe_full,
    weights="fusesr-{scale}x.safetensors",
    measured_by={"python benchmarks/results.py DATA": "docs/results.md"},
)

FUSESR_FAST = System(
    name="fusesr-fast",
    summary="the light H-shaped network: no history, no motion",
    citation=CITATION,
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH),
    lr_optional=LR_OPTIONAL,
    hr_inputs=HR_BUFFERS,
    hr_optional=(*HR_OPTIONAL, *GUIDES),
    scales=(2, 4, 8),
    halo_px=FAST_HALO_PX,
    derivation=derivation,
    config=FuseSRFastConfig,
    build=FuseSRFastNetwork,
    predict=neural_predict(prepare, compose),
    learning=LEARNING,
    graphs=describe_fast,
    weights="fusesr-fast-{scale}x.safetensors",
    measured_by={"python benchmarks/results.py DATA": "docs/results.md"},
)

FUSESR_DIRECT = System(
    name="fusesr-direct",
    summary="H-shaped network that predicts radiance without demodulation",
    citation=CITATION,
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION),
    hr_inputs=(*HR_BUFFERS, Buffer.ALBEDO, Buffer.DEPTH, Buffer.NORMAL),
    scales=(4, 8),
    history_frames=HISTORY_FRAMES,
    halo_px=None,
    derivation=derivation,
    config=FuseSRDirectConfig,
    build=FuseSRNetwork,
    predict=neural_predict(prepare, compose),
    learning=LEARNING,
    graphs=describe_full,
    weights="fusesr-direct-{scale}x.safetensors",
)

SYSTEMS = (FUSESR, FUSESR_FAST, FUSESR_DIRECT)
