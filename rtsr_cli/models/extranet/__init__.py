"""`extranet`: frames between rendered ones, by a network of light gated convolutions.

Guo et al., "ExtraNet: Real-time Extrapolated Rendering for Low-latency Temporal Supersampling",
SIGGRAPH Asia 2021. From three rendered frames, moved to the predicted one, and that frame's
G-buffer, its log lighting is predicted and multiplied by its material.

Conventions: full resolution, scale 1; every second frame is rendered; the predicted frame's
radiance is only what training compares with.

Departs from the publication in the preset `rtsr`: the network corrects `warp-guided`, lighting
carried and filled along surfaces, in place of the lighting along the vectors; e = log(1 + q / k), k
of the last rendered frame; radiance is divided by the split-sum material; holes are where no past
pixel is of the surface; depth is 1 / (1 + metres). `paper` keeps the published choices around the
same layers. In both the sky is predicted like all else.
"""

from __future__ import annotations

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.lighting.past_lighting import (
    OPTIONAL_BUFFERS,
    SHADED_BUFFERS,
    UNSHADED_BUFFERS,
)
from rtsr_cli.core.system import (
    FrameJudge,
    FrameWindow,
    Prediction,
    System,
    Tensors,
    TrainingRecipe,
    WholeFrames,
    neural_predict,
)
from rtsr_cli.models.extranet.config import CADENCE, HISTORY_FRAMES, ExtraNetConfig
from rtsr_cli.models.extranet.graphs import describe
from rtsr_cli.models.extranet.inputs import derivation, prepare
from rtsr_cli.models.extranet.loss import change, decode_radiance, goal, loss, panels, scores
from rtsr_cli.models.extranet.network import PICTURE, ExtraNetNetwork


def compose(
    config: ExtraNetConfig, window: FrameWindow, inputs: Tensors, outputs: Tensors
) -> Prediction:
    """Radiance of the predicted e."""
    del config, window
    predicted = outputs["predicted"].float()
    return Prediction(
        image=decode_radiance(predicted, inputs),
        debug={
            "log_lighting": predicted,
            "base": inputs["current"][:, PICTURE],
            "hole": inputs["hole_mask"],
        },
    )


EXTRANET = System(
    name="extranet",
    summary="network of light gated convolutions: corrects past lighting by three rendered frames",
    citation="Guo et al., ExtraNet, SIGGRAPH Asia 2021",
    task=SystemTask.EXTRAPOLATE,
    lr_inputs=SHADED_BUFFERS,
    lr_optional=OPTIONAL_BUFFERS,
    unshaded_inputs=(*UNSHADED_BUFFERS, Buffer.ROUGHNESS, Buffer.METALLIC),
    unshaded_optional=OPTIONAL_BUFFERS,
    rendered_every=CADENCE,
    scales=(1,),
    history_frames=HISTORY_FRAMES,
    halo_px=None,
    derivation=derivation,
    config=ExtraNetConfig,
    build=ExtraNetNetwork,
    predict=neural_predict(prepare, compose),
    learning=TrainingRecipe(
        prepare=prepare,
        reference=(Buffer.COLOR,),
        goal=goal,
        loss=loss,
        whole=WholeFrames(change=change, sought="hole_mask"),
        defaults={"scale": 1, "crop": 128, "learning_rate": 1e-3},
        judge=FrameJudge(
            names=("psnr", "hole_psnr", "flip"),
            scores=scores,
            panels=panels,
            protocol="PSNR after c / (1 + c) over all pixels, and over holes; FLIP after sRGB on "
            "top of it",
        ),
    ),
    graphs=describe,
    weights="extranet.safetensors",
    measured_by={"python benchmarks/extrapolation.py DATA": "docs/extrapolate.md"},
)

SYSTEMS = (EXTRANET,)
