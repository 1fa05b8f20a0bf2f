"""`nsrd`: recurrent super-resolution of demodulated radiance.

Li et al., "Neural Super-Resolution for Real-time Rendering with Radiance Demodulation", CVPR 2024.
Lighting of the current frame and two past ones, moved to it and marked by dual motion vectors, the
last HR output and a convolutional LSTM's state make the HR lighting, which is multiplied by the HR
material.

Conventions: those of `core.lighting`. History that is missing is the current frame, marked
unreliable; the last output and the state are zeros then.

Departs from the publication in the preset `rtsr`: the network sees and predicts log(1 + L/k), k of
the current frame, past frames included; depth is 1 / (1 + metres); its output is added to an
enlargement of the lighting along HR surfaces; of the last output it sees the difference from that,
where reliable; warps are pixel-centred and scaled, motion to t-2 is chained, the LSTM's state moves
with the surfaces, a whole number of pixels a frame; emission is added and sky enlarged on its own.
`paper` keeps the published choices around the same layers, and replaces radiance by emission where
there is any.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.derive import DerivationConfig
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.lighting import (
    GUIDES,
    HR_BUFFERS,
    HR_OPTIONAL,
    LR_BUFFERS,
    REFERENCE_BUFFERS,
    Preset,
    aligned,
    compose_lighting,
    hr_frame,
    lighting_goal,
    lighting_loss,
    unaligned,
    with_sky,
)
from rtsr_cli.core.metrics.ssim import ssim
from rtsr_cli.core.system import Learning, Prediction, System, Tensors, Window, neural_predict
from rtsr_cli.models.nsrd.config import HISTORY_FRAMES, UNROLLED_FRAMES, NSRDConfig
from rtsr_cli.models.nsrd.network import NSRDNetwork
from rtsr_cli.models.nsrd.seeing import prepare

EMISSIVE = 1e-4
"""Emission from which, in any channel, `paper` shows it instead of the prediction [NSRD, code]."""

PREROLL_FRAMES = 8
"""What a shard replays. Its first frame was then 58 to 67 dB from the whole run's where that was
measured (`benchmarks/shards.py` and a moving scene), and each later one nearer."""


def derivation(config: NSRDConfig) -> DerivationConfig:
    """What divides the radiance of a config."""
    return config.derivation


def compose(config: NSRDConfig, window: Window, inputs: Tensors, outputs: Tensors) -> Prediction:
    """Radiance from predicted lighting; of what was decided, where the last output was used."""
    prediction = compose_lighting(config.preset, window, inputs, outputs["predicted"].clamp(min=0))
    image = prediction.image
    debug = {**prediction.debug, "unreliable": unaligned(window, inputs["unreliable_hr"])}
    if config.preset is Preset.RTSR or image is None:
        return Prediction(image=image, debug=debug)
    emission = hr_frame(window).gbuffer.buffers.get(Buffer.EMISSION)
    if emission is not None:
        shines = (emission.abs() >= EMISSIVE).any(dim=1, keepdim=True)
        image = torch.where(shines, emission, image)
    return Prediction(image=with_sky(window, image), debug=debug)


def goal(config: NSRDConfig, window: Window, reference: Frame) -> Tensors:
    """What the capture's lighting is; in `paper` as it is."""
    target = lighting_goal(config.preset, window, reference)
    if config.preset is Preset.PAPER:
        target["lighting"] = aligned(window, reference.gbuffer[Buffer.LIGHTING])
    return target


def loss(config: NSRDConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """Weighted terms of `NSRDLossWeights` that weigh anything.

    smooth L1(p, g) + (1 - SSIM(p, g)) + smooth L1(m p', m p)         [NSRD, code]

    p' is the prediction before, moved, and m where it is reliable and, in `rtsr`, was divided; the
    first frame of a clip has none, and its first term is not taken twice.
    """
    weights, predicted = config.loss_weights, outputs["predicted"].float()
    terms: dict[str, Tensor] = {}
    if weights.log or weights.tonemapped or weights.tonemapped_squared or weights.radiance:
        terms |= lighting_loss(weights, predicted, inputs=inputs, goal=target, preset=config.preset)
    wanted = target["lighting" if config.preset is Preset.PAPER else "encoded"]
    if weights.smooth:
        terms["smooth"] = weights.smooth * F.smooth_l1_loss(predicted, wanted)
    if weights.structure:
        similar = ssim(predicted, wanted, SsimConvention.ZERO_PAD).mean()
        terms["structure"] = weights.structure * (1.0 - similar)
    if weights.temporal:
        previous = outputs.get("previous", predicted)
        reliable = 1.0 - inputs["unreliable_hr"]
        if config.preset is Preset.RTSR:
            reliable = reliable * target["divided_mask"]
        change = F.smooth_l1_loss(reliable * predicted, reliable * previous)
        terms["temporal"] = weights.temporal * change
    return terms


NSRD = System(
    name="nsrd",
    summary="recurrent network over lighting, dual motion vectors and its own last output",
    citation="Li et al., NSRD, CVPR 2024",
    lr_inputs=(*LR_BUFFERS, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION),
    lr_optional=(Buffer.FORWARD,),
    hr_inputs=HR_BUFFERS,
    hr_optional=(*HR_OPTIONAL, *GUIDES),
    scales=(2, 4, 6),
    history_frames=HISTORY_FRAMES,
    recurrent=True,
    preroll_frames=PREROLL_FRAMES,
    halo_px=None,
    derivation=derivation,
    config=NSRDConfig,
    build=NSRDNetwork,
    predict=neural_predict(prepare, compose),
    learning=Learning(
        prepare=prepare,
        reference=REFERENCE_BUFFERS,
        goal=goal,
        loss=loss,
        unroll=UNROLLED_FRAMES,
        defaults={"batch": 4, "freeze_statistics": 0.8},
    ),
    weights="nsrd-{scale}x.safetensors",
)

SYSTEMS = (NSRD,)
