"""What a person reads of predicted shading rates."""

from __future__ import annotations

from rtsr_cli.commands.log import LOG
from rtsr_cli.commands.options import describe_rates
from rtsr_cli.core.choices import Estimator, VrsMetric
from rtsr_cli.core.run.events import ShotPlanned
from rtsr_cli.core.vrs.call import RatesSummary


def describe_plan(plan: ShotPlanned) -> str:
    """Say what a plan decides by."""
    details = plan.details
    metric = details["metric"]
    side = "above" if metric is VrsMetric.PSNR else "below"
    limits = {
        Estimator.NETWORK: f"{metric} {side} {details['threshold']:g}",
        Estimator.ANALYTIC: f"analytic estimate below {details['analytic_threshold']:g}",
    }
    text = limits.get(details["estimator"], ", ".join(limits.values()))
    what = f", tiles of {details['tile']}, {text}"
    captured = details["captured_rates"]
    return f"{what}, {describe_rates(captured)}" if captured else what


def show_summary(event: object) -> None:
    """Say what was saved, at which error."""
    if not isinstance(event, RatesSummary) or not event.total["frames"]:
        return
    total, options = event.total, event.options
    shares = ", ".join(f"{name} {share:.1%}" for name, share in total["shares"].items() if share)
    # no zero with a sign
    saved = round(100 * total["invocations_saved"], 1) + 0.0
    LOG.info("shading invocations saved %.1f %% (%s)", saved, shares)
    if "true_error" in total:
        LOG.info(
            "true error of these rates %.4f on average; %.2f %% of the tiles miss %s %g",
            total["true_error"],
            100 * total["missed"],
            options.error.metric,
            options.threshold,
        )
    if "r2" in total:
        LOG.info(
            "predicted errors beside the true ones: R2 %.3f, off by %.3f on average, of "
            "which %.3f too low",
            total["r2"],
            total["mae"],
            total["under"],
        )
