"""What users choose by name, each an enum, and numbers that requests share with the code.

Imports nothing, so that help is instant.
"""

from __future__ import annotations

from enum import StrEnum

MATERIAL_EPSILON = 4e-3
"""Smallest channel of a material term that radiance is divided by."""

MOST_MATERIAL = 2.0
"""Largest channel of one: all that arrives, diffuse, and all of it again, mirrored at grazing
angles. What predicted lighting is wrong by is multiplied by it."""


class SystemTask(StrEnum):
    """What a system predicts."""

    UPSCALE = "upscale"
    PREDICT_VRS = "predict-vrs"
    EXTRAPOLATE = "extrapolate"


class InputCondition(StrEnum):
    """What inputs must be like, beside holding its buffers, for a system to be preferred."""

    TRUSTED_MOTION = "motion that is declared or measured without doubt"
    JITTER = "jitter that differs from frame to frame"
    POINT_SAMPLES = "radiance that no pixel filter went over"


class Preset(StrEnum):
    """What surrounds a network's layers: this project's choices, or the publication's."""

    RTSR = "rtsr"
    PAPER = "paper"


class MissingPolicy(StrEnum):
    """What a hole in the numbering means for the run."""

    ERROR = "error"
    SKIP = "skip"
    HOLD = "hold"


class NonfinitePolicy(StrEnum):
    """What NaN and Inf in an input mean for the frame."""

    ERROR = "error"
    ZERO = "zero"
    INPAINT = "inpaint"


class JitterMode(StrEnum):
    """Which sample of a block a simulated LR frame keeps."""

    NONE = "none"
    HALTON = "halton"


class PixelFilter(StrEnum):
    """What a simulated LR pixel's radiance is filtered by before one sample is kept."""

    NONE = "none"
    BOX = "box"
    BLACKMAN_HARRIS = "blackman-harris"


class DemodulationMode(StrEnum):
    """What radiance is divided by."""

    BRDF = "brdf"
    SOFTPLUS = "softplus"
    ALBEDO = "albedo"
    GLOSSY_ALBEDO = "glossy-albedo"
    NONE = "none"


class LutConvention(StrEnum):
    """How a roughness becomes the width `alpha` of GGX and the `k` of Smith-Schlick."""

    KARIS = "karis"
    """alpha = roughness^2, k = alpha / 2: perceptual roughness, image-based lighting."""

    SEED = "seed"
    """alpha = roughness, k = (alpha + 1)^2 / 8: as the NSRD supplementary text has it."""


class VrsMetric(StrEnum):
    """What an error is measured by."""

    FLIP = "flip"
    JNFLIP = "jnflip"
    JNYANG = "jnyang"
    PSNR = "psnr"
    LPIPS = "lpips"


class Pool(StrEnum):
    """What a tile's value is of its pixels."""

    MAX = "max"
    MEAN = "mean"


class Estimator(StrEnum):
    """What decides rates."""

    NETWORK = "network"
    ANALYTIC = "analytic"
    HYBRID = "hybrid"
    """Analytic on tiles that the frame before shows, the network on the others."""


class Precision(StrEnum):
    """Number format of network layers."""

    AUTO = "auto"
    FP32 = "fp32"
    BF16 = "bf16"
    FP16 = "fp16"


class Runtime(StrEnum):
    """What computes the layers of a network."""

    TORCH = "torch"
    ONNX = "onnx"
    """onnxruntime, files of `export`."""


class LabelKind(StrEnum):
    """What labels say of a frame."""

    VRS = "vrs"
    """True errors of shading rates."""
    HOLES = "holes"
    """What past frames do not show."""
    CGTS = "cgts"
    """Ghosting and aliasing pixels."""


class MetricName(StrEnum):
    """What `evaluate` judges by, in the order of its tables."""

    PSNR = "psnr"
    SSIM = "ssim"
    MS_SSIM = "ms-ssim"
    FLIP = "flip"
    HDR_FLIP = "hdr-flip"
    LPIPS = "lpips"
    VMAF = "vmaf"
    TPSNR = "tpsnr"
    TEMPORAL = "temporal"
    WARPED = "warped"


class ProtocolName(StrEnum):
    """How linear frames are shown to metrics, by whose publication."""

    RTSR = "rtsr"
    NSRD = "nsrd"
    FUSESR = "fusesr"
    EXTRANET = "extranet"


class SsimConvention(StrEnum):
    """Whose SSIM it is."""

    WANG = "wang"
    """Gaussian 11 / 1.5, whole windows only: Wang et al. 2004, scikit-image with
    `gaussian_weights=True, sigma=1.5, use_sample_covariance=False`."""
    SKIMAGE7 = "skimage7"
    """Uniform 7 x 7, sample covariance, whole windows only: scikit-image's default (ExtraNet)."""
    SKIMAGE11 = "skimage11"
    """The same, 11 x 11 (NSRD)."""
    ZERO_PAD = "zero-pad"
    """Gaussian 11 / 1.5, black around the frame: pytorch_ssim (FuseSR)."""
    TORCHMETRICS = "torchmetrics"
    """Gaussian 11 / 1.5, the frame mirrored around itself: torchmetrics 1.9."""


class FarmEngine(StrEnum):
    """What runs the jobs of a farm."""

    OPENJD = "openjd"
    SLURM = "slurm"
