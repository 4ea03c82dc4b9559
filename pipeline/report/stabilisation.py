"""Draw the stabilisation diagram of an identified window over its spectrum as a PNG."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from pipeline.oma.identification import Identification
from pipeline.report.canvas import new_figure
from pipeline.state.phrases import count_noun
from sensors.arrays import FloatArray
from sensors.errors import InputError

LINES_PER_WINDOW = 20  # segments of the Welch spectrum in the window, halves overlapping
DIAGRAM_DOTS_PER_INCH = 120
LABEL_RATIO = 1.06  # between two frequencies that are written, so that they do not overlap


def draw_stabilisation(
    identification: Identification,
    samples: FloatArray,
    sampling_rate: float,
    path: Path,
    *,
    title: str = "",
) -> None:
    """Write the stabilisation diagram over the spectrum.

    Above, the stable poles over the model orders with the standard deviations of their frequencies
    and a line for each mode; below, the singular values of the spectral matrix.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Samples of the identified window.
    sampling_rate : float
        Sampling rate [Hz].
    title : str, optional
        Name of what was identified, for the heading.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    figure = new_figure((11, 8))
    poles_axes, spectrum_axes = figure.subplots(2, 1, sharex=True)
    _draw_poles(poles_axes, identification)
    _draw_spectrum(spectrum_axes, samples, sampling_rate)
    _draw_modes((poles_axes, spectrum_axes), identification)
    _draw_refused(poles_axes, identification)
    found = f"{count_noun(len(identification.modes), 'mode')}; bars are one standard deviation"
    figure.suptitle(f"{title}: {found}" if title else found)
    if identification.modes:
        lowest = 0.6 * identification.modes[0].frequency
        spectrum_axes.set_xlim(lowest, 0.5 * sampling_rate)
    spectrum_axes.set_xscale("log")
    spectrum_axes.xaxis.set_major_locator(_log_ticks())
    spectrum_axes.xaxis.set_major_formatter("{x:g}")
    try:
        figure.savefig(path, dpi=DIAGRAM_DOTS_PER_INCH, format=path.suffix[1:] or "png")
    except (OSError, ValueError) as error:  # ValueError: a suffix that no picture has
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot write the figure {path}: {reason}") from error


def _log_ticks() -> Any:
    from matplotlib.ticker import LogLocator

    return LogLocator(subs=(1.0, 2.0, 5.0))


def _draw_poles(axes: Any, identification: Identification) -> None:
    for band, poles in enumerate(identification.diagrams):
        axes.errorbar(
            poles.frequencies,
            poles.orders,
            xerr=poles.frequency_stds,
            fmt="o",
            markersize=2.5,
            elinewidth=0.6,
            label=f"band {band + 1}",
        )
    axes.set_ylabel("model order [-]")
    if identification.diagrams:
        axes.legend(loc="upper left", fontsize="small", title="slowest band first")


def _draw_modes(all_axes: Sequence[Any], identification: Identification) -> None:
    """Draw a line at every mode through both panels, with its frequency where there is room."""
    written = 0.0
    for mode in identification.modes:
        for axes in all_axes:
            axes.axvline(mode.frequency, color="black", linewidth=0.6, alpha=0.5)
        if mode.frequency > LABEL_RATIO * written:
            written = mode.frequency
            all_axes[0].annotate(
                f"{mode.frequency:.4g} Hz",
                (mode.frequency, 1.0),
                xytext=(0, 3),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                rotation=60,
                fontsize="x-small",
            )


def _draw_refused(axes: Any, identification: Identification) -> None:
    """Mark what looked like a mode and was refused with the code of its reason."""
    for each in identification.refused:
        axes.axvline(each.frequency, color="tab:red", linewidth=0.5, alpha=0.5, linestyle=":")
        axes.annotate(
            each.code,
            (each.frequency, 0.02),
            xycoords=("data", "axes fraction"),
            rotation=90,
            color="tab:red",
            fontsize="xx-small",
        )


def _draw_spectrum(axes: Any, samples: FloatArray, sampling_rate: float) -> None:
    frequencies, singular_values = spectral_singular_values(samples, sampling_rate)
    axes.semilogy(frequencies[1:], singular_values[1:], linewidth=0.8)
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("singular values of the spectrum [unit²/Hz]")


def spectral_singular_values(
    samples: FloatArray, sampling_rate: float
) -> tuple[FloatArray, FloatArray]:
    """Estimate the singular values of the spectral matrix by Welch's method.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Samples of the window [unit].
    sampling_rate : float
        Sampling rate [Hz].

    Returns
    -------
    frequencies : ndarray, shape (n_frequencies,)
        Frequencies [Hz].
    singular_values : ndarray, shape (n_frequencies, n_channels)
        Singular values at each frequency, largest first [unit²/Hz].
    """
    length = max(16, 2 * len(samples) // (LINES_PER_WINDOW + 1))
    y = samples - samples.mean(axis=0)
    frequencies, density = signal.csd(
        y.T[:, None], y.T[None, :], sampling_rate, nperseg=min(length, len(y)), axis=-1
    )
    matrices = np.moveaxis(density, -1, 0)
    return frequencies, np.linalg.svd(matrices, compute_uv=False)
