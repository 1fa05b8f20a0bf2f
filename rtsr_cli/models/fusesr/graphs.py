"""What is exported of FuseSR's networks.

The full one is two graphs, as features of past frames are warped between them; the fast one is one.
"""

from __future__ import annotations

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.graphs import (
    CarriedTensor,
    Graph,
    GraphTensor,
    NetworkGraphs,
    OutsideStep,
)
from rtsr_cli.core.lighting.graph_steps import (
    BASE,
    COMPOSE,
    INVERSE_DEPTH,
    KEEP_UNSEEN,
    LIGHTING,
    MATERIAL,
    MOST_LOG,
    NORMAL,
    PREDICTED,
    list_steps_before,
    require_own_preset,
)
from rtsr_cli.models.fusesr.config import HISTORY_FRAMES, FuseSRConfig

HR_CHANNELS = {
    Buffer.MATERIAL: MATERIAL,
    Buffer.DEPTH: (f"{INVERSE_DEPTH}, of the HR G-buffer, aligned",),
    Buffer.NORMAL: NORMAL,
    Buffer.ALBEDO: (
        "albedo red, HR, aligned, linear",
        "albedo green",
        "albedo blue",
    ),
}

FRAME_CHANNELS = (*LIGHTING, INVERSE_DEPTH, *NORMAL)

FEATURES = GraphTensor(name="main", channels=("32 features",), most=2.0)

WARP = OutsideStep(
    name="warp",
    when="before",
    formula="past_n(p) = main of frame t-n at the pixel nearest to p + motion_n(p), 0 outside; "
    "depth_n the same of channel 3 of its frame, borders replicated; motion_n from the samples of "
    "t to those of t-n, LR pixels, jitter included: previous position = position + motion",
)


def _list_hr(config: FuseSRConfig) -> tuple[GraphTensor, ...]:
    channels = tuple(channel for part in config.hr_parts for channel in HR_CHANNELS[part])
    return (GraphTensor(name="hr", channels=channels, least=-1.0),)


def _list_before(config: FuseSRConfig) -> tuple[OutsideStep, ...]:
    return list_steps_before(config.demodulation, config.lut, config.base)


def describe_fast(config: FuseSRConfig) -> NetworkGraphs:
    """What is exported of the fast network.

    Raises:
        ConfigError: it is of the publication's preset.
    """
    require_own_preset(config.preset)
    frame = GraphTensor(name="frame_0", channels=FRAME_CHANNELS, least=-1.0, most=MOST_LOG)
    return NetworkGraphs(
        graphs=(
            Graph(
                method="correct",
                summary="LR samples, HR material and the enlarged lighting -> HR lighting",
                inputs=(frame, *_list_hr(config), BASE),
                outputs=(PREDICTED,),
            ),
        ),
        outside=(*_list_before(config), KEEP_UNSEEN, COMPOSE),
    )


def describe_full(config: FuseSRConfig) -> NetworkGraphs:
    """What is exported of the full network.

    Raises:
        ConfigError: it is of the publication's preset.
    """
    require_own_preset(config.preset)
    frame = GraphTensor(name="frame", channels=FRAME_CHANNELS, least=-1.0, most=MOST_LOG)
    shallow = GraphTensor(name="shallow", channels=("64 features",), most=2.0)
    ages = range(1, HISTORY_FRAMES + 1) if config.history else range(0)
    depth = (GraphTensor(name="depth", channels=(INVERSE_DEPTH,)),) if config.history else ()
    return NetworkGraphs(
        graphs=(
            Graph(
                method="encode",
                summary="an LR frame -> its features, once a frame",
                inputs=(frame,),
                outputs=(shallow, FEATURES),
            ),
            Graph(
                method="fuse",
                summary="features of the frame, those of past ones, HR buffers -> HR lighting",
                inputs=(
                    shallow,
                    FEATURES,
                    *(tensor for age in ages for tensor in _list_past(age)),
                    *depth,
                    *_list_hr(config),
                    BASE,
                ),
                outputs=(PREDICTED,),
            ),
        ),
        outside=(*_list_before(config), *((WARP,) if config.history else ()), KEEP_UNSEEN, COMPOSE),
        carried=tuple(
            CarriedTensor(
                name=f"past_{age}",
                made=f"main, of the frame {age} before",
                reset="main of the current frame, motion 0",
                moved="warp",
            )
            for age in ages
        ),
    )


def _list_past(age: int) -> tuple[GraphTensor, ...]:
    """What is fetched of the frame so many before."""
    return (
        GraphTensor(name=f"past_{age}", channels=(f"main of t-{age}, warped",), most=2.0),
        GraphTensor(name=f"depth_{age}", channels=(f"{INVERSE_DEPTH}, of t-{age}, warped",)),
        GraphTensor(
            name=f"motion_ndc_{age}",
            channels=(f"2 dx / width of motion_{age}", f"2 dy / height of motion_{age}"),
            least=-0.2,
            most=0.2,
        ),
    )
