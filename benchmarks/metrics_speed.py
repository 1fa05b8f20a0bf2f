"""Time and memory of PSNR, SSIM and FLIP at 1080p against scikit-image and flip-evaluator.

    python benchmarks/metrics_speed.py [--pairs 5] [--hdr]

Ratios of wall time in one process with one thread each, ours and theirs in turn, so that another
load on the machine falls on both; medians of the pairs. Then the throughput of two such processes
at once against one (by CPU time, another load on the machine's cores does not show), and the peak
memory of one.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # read when torch and flip-evaluator are loaded

import multiprocessing
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import click
import flip_evaluator
import numpy as np
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from rtsr_cli.core.metrics.fidelity import psnr
from rtsr_cli.core.metrics.flip import hdr_flip, ldr_flip
from rtsr_cli.core.metrics.ssim import ssim

HEIGHT, WIDTH = 1080, 1920
BYTES_PER_MB = 1e6
REPEATS = 5
Images = tuple[torch.Tensor, torch.Tensor]


def picture_pair() -> Images:
    """Smooth waves with a grain of their own in each image, 0..1."""
    generator = torch.Generator().manual_seed(7)
    y = torch.linspace(0.0, 40.0, HEIGHT)[:, None]
    x = torch.linspace(0.0, 70.0, WIDTH)
    waves = torch.stack([torch.sin(x + y), torch.sin(2 * x - y), torch.cos(x * y / 9)])
    ref = (0.5 + 0.4 * waves)[None]
    grain = torch.rand(ref.shape, generator=generator) - 0.5
    return (ref + 0.1 * grain).clamp(0.0, 1.0), ref


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def compare(name: str, ours: Callable[[], object], theirs: Callable[[], object], n: int) -> None:
    """Print the medians of n pairs, and of their ratios."""
    ours(), theirs()
    pairs = [(seconds(ours), seconds(theirs)) for _ in range(n)]
    mine, other = (statistics.median(times) for times in zip(*pairs, strict=True))
    ratios = sorted(a / b for a, b in pairs)
    print(
        f"{name:22} ours {mine:7.3f} s  theirs {other:7.3f} s  "
        f"ratio {statistics.median(ratios):.3f} ({ratios[0]:.3f} to {ratios[-1]:.3f})"
    )


def our_metrics(images: Images) -> None:
    psnr(*images), ssim(*images), ldr_flip(*images)


def their_metrics(test: np.ndarray, ref: np.ndarray) -> None:
    peak_signal_noise_ratio(ref, test, data_range=1.0)
    their_ssim(test, ref)
    their_flip(test, ref, "LDR")


def their_ssim(test: np.ndarray, ref: np.ndarray) -> None:
    structural_similarity(
        ref,
        test,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1.0,
    )


def their_flip(test: np.ndarray, ref: np.ndarray, mode: str) -> None:
    flip_evaluator.evaluate(ref, test, mode, mode == "LDR", False, True, {})


def peak_bytes(*, forget: bool = False) -> int:
    """Largest resident size of this process so far, or since it was last told to forget (Linux)."""
    if forget:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024


def worker(barrier: object, queue: object) -> None:
    """Run our metrics `REPEATS` times, from a common start; report wall, CPU time and memory."""
    torch.set_num_threads(1)
    images = picture_pair()
    with torch.no_grad():
        before = peak_bytes(forget=True)
        our_metrics(images)
        after = peak_bytes()
        barrier.wait()
        cpu = time.process_time()
        wall = seconds(lambda: [our_metrics(images) for _ in range(REPEATS)])
    queue.put((wall, time.process_time() - cpu, before, after))


def together(jobs: int) -> list[tuple[float, float, int, int]]:
    """Run `jobs` workers at once."""
    context = multiprocessing.get_context("spawn")
    barrier, queue = context.Barrier(jobs), context.Queue()
    processes = [context.Process(target=worker, args=(barrier, queue)) for _ in range(jobs)]
    for process in processes:
        process.start()
    results = [queue.get() for _ in processes]
    for process in processes:
        process.join()
    return results


@click.command()
@click.option("--pairs", default=5, show_default=True, help="Interleaved pairs of runs.")
@click.option("--hdr", is_flag=True, help="HDR-FLIP too (a minute a pair).")
def main(pairs: int, hdr: bool) -> None:
    """Print the ratios."""
    torch.set_num_threads(1)
    images = picture_pair()
    pictures = [image[0].permute(1, 2, 0).contiguous().numpy() for image in images]
    with torch.no_grad():
        compare("LDR-FLIP", lambda: ldr_flip(*images), lambda: their_flip(*pictures, "LDR"), pairs)
        compare("SSIM", lambda: ssim(*images), lambda: their_ssim(*pictures), pairs)
        compare(
            "PSNR + SSIM + LDR-FLIP",
            lambda: our_metrics(images),
            lambda: their_metrics(*pictures),
            pairs,
        )
        if hdr:
            compare(
                "HDR-FLIP", lambda: hdr_flip(*images), lambda: their_flip(*pictures, "HDR"), pairs
            )
    rounds = [(together(1)[0], together(2)) for _ in range(pairs)]
    for clock, name in enumerate(("wall", "CPU")):
        gains = [2.0 * one[clock] / max(job[clock] for job in two) for one, two in rounds]
        print(f"two jobs at once, {name} time: {statistics.median(gains):.2f} x one's throughput")
    before, after = rounds[0][0][2:]
    print(
        f"peak memory: {after / BYTES_PER_MB:.0f} MB, {before / BYTES_PER_MB:.0f} MB of it the "
        "program and the two images"
    )


if __name__ == "__main__":
    main()
