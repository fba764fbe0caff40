"""luxel filter: a low-pass filter from picture to picture."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds
from luxel.errors import InputError

if TYPE_CHECKING:
    from luxel.arrays import Array
    from luxel.cluster.comm import Comm
    from luxel.filter.filters import Filter

EXAMPLE = "luxel filter photo.png -o soft.png --gaussian 2.5 --spectrum spectrum.png"

_BORDERS = ("mirror", "clamp", "wrap", "constant")
_METHODS = ("auto", "separable", "direct", "tiles", "fft", "dct")
_BAND = 1 << 26  # bytes of float32 numbers: large enough, and small enough for the system to give the same memory again
_BANDS_EACH = 4  # for each rank, so that they end together
_EXTENSIONS = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff", ".exr", ".npy")


def _option(heading: str | None, *names: str, metavar: str, help: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help, rich_help_panel=heading, show_default=False)


_which = partial(_option, "Which filter (one of them)")
_how = partial(_option, "How")
File = Annotated[Path, typer.Argument(metavar="FILE", help="A picture of 8 or 16 bits, an .exr or .hdr, or an array (.npy).", show_default=False)]
Output = Annotated[Path | None, _option(None, "-o", "--output", metavar="OUT", help="The result: .png, .jpg, .exr, .npy and others.")]
Spectrum = Annotated[Path | None, _option(None, "--spectrum", metavar="PNG", help="The magnitude of the spectrum, before and after.")]
Gaussian = Annotated[str | None, _which("--gaussian", metavar="SIGMA", help="A Gaussian of this standard deviation, in pixels.")]
Butterworth = Annotated[str | None, _which("--butterworth", metavar="CUTOFF", help="Half the energy passes at this frequency ...")]
Order = Annotated[str | None, _which("--order", metavar="N", help="... and the less beyond, the higher this is [2].")]
Ideal = Annotated[str | None, _which("--ideal", metavar="CUTOFF", help="Nothing passes beyond this frequency (rings at edges).")]
Kernel = Annotated[Path | None, _which("--kernel", metavar="FILE", help="Weights: a picture (scaled to sum to 1), or an array (.npy).")]
Border = Annotated[str, _how("--border", metavar="NAME", help=f"Beyond the picture: {', '.join(_BORDERS)} [mirror].")]
Value = Annotated[str, _how("--value", metavar="X", help="The constant, in linear light [0].")]
Method = Annotated[str, _how("--method", metavar="NAME", help=f"{', '.join(_METHODS)}: the same to rounding [auto: the fastest].")]
Memory = Annotated[str, _how("--memory", metavar="MB", help="Larger pictures go in bands, from disk to disk [2048].")]
Threads = Annotated[str | None, _how("--threads", metavar="N", help="Of the processor, each rank [all, shared by the ranks].")]


def filter(
    file: File,
    output: Output = None,
    spectrum: Spectrum = None,
    gaussian: Gaussian = None,
    butterworth: Butterworth = None,
    order: Order = None,
    ideal: Ideal = None,
    kernel: Kernel = None,
    border: Border = "mirror",
    value: Value = "0",
    method: Method = "auto",
    memory: Memory = "2048",
    threads: Threads = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Take the high frequencies out of a picture, in linear light.

    Frequencies are in cycles per pixel; 0.5 is the highest. Under mpiexec the ranks share the work, and one file is written.
    """
    from luxel.cli.ranks import share_work
    from luxel.cluster.comm import world

    comm = world()
    console = Console(quiet or comm.rank > 0, as_json and comm.rank == 0)
    with comm.guard():
        if output is None and spectrum is None:
            raise InputError("expected -o OUT, --spectrum PNG or both: nothing would be written")
        for path, extensions, option in ((output, _EXTENSIONS, "--output"), (spectrum, (".png",), "--spectrum")):
            if path is not None:
                values.output(path, extensions, option)
        chosen = _chosen(gaussian, butterworth, order, ideal, kernel)
        if chosen is None and output is not None:
            raise InputError("expected one of --gaussian, --butterworth, --ideal and --kernel")
        options: dict[str, Any] = {
            "border": values.choice(border, _BORDERS, "--border"),
            "value": values.number(value, "--value", "a number"),
            "method": values.choice(method, _METHODS, "--method"),
        }
        limit = values.whole(memory, "--memory", 1) << 20
        number = None if threads is None else values.whole(threads, "--threads", 1)
        words = (gaussian, butterworth, order, ideal, kernel)
        share_work(comm, file=file, output=output, spectrum=spectrum, filter=words, memory=limit, threads=number, **options)
        _filter_file(console, comm, file, output, spectrum, chosen, options, limit, number)


def _chosen(gaussian: str | None, butterworth: str | None, order: str | None, ideal: str | None, kernel: Path | None) -> Filter | None:
    from luxel.filter.files import kernel_file
    from luxel.filter.filters import make_filter

    named = {"--gaussian": gaussian, "--butterworth": butterworth, "--ideal": ideal, "--kernel": kernel}
    given = [name for name, text in named.items() if text is not None]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)}: one of them")
    if order is not None and butterworth is None:
        raise InputError("--order is for --butterworth")
    if gaussian is not None:
        return make_filter(gaussian=values.number(gaussian, "--gaussian", "a number of pixels"))
    if butterworth is not None:
        pair = values.number(butterworth, "--butterworth", "a number of cycles per pixel"), values.number(order or "2", "--order", "a number above 0")
        return make_filter(butterworth=pair)
    if ideal is not None:
        return make_filter(ideal=values.number(ideal, "--ideal", "a number of cycles per pixel"))
    return None if kernel is None else make_filter(kernel=kernel_file(kernel))


def _filter_file(console: Console, comm: Comm, file: Path, output: Path | None, spectrum: Path | None, chosen: Filter | None,
                 options: dict[str, Any], memory: int, threads: int | None) -> None:  # fmt: skip
    start = time.perf_counter()
    number = comm.threads(threads)
    if comm.rank:
        _help(comm, chosen, {**options, "threads": number})
        return
    from luxel.filter.files import opened

    with opened(file, memory) as source, console.work("filtering") as report:
        height, width, channels = shape = source.array.shape
        whole = 4 * height * width * channels <= memory
        if spectrum is not None and not whole:
            raise InputError(f"--spectrum: {width}x{height} is more than --memory holds")
        sooner = comm.size > 1 or 4 * height * width * channels > 4 * _BAND  # by bands, where the filter is a kernel
        banded = chosen is not None and (not whole or (sooner and chosen.kernel is not None and spectrum is None))
        if banded:
            assert chosen is not None
            assert output is not None
            _in_bands(comm, source, output, chosen, {**options, "threads": number, "memory": min(memory // 4, _BAND) // comm.neighbours}, report)
        else:
            comm.share("whole" if chosen is not None else None)
            _in_memory(comm, source, output, spectrum, chosen, options, number)
    took = time.perf_counter() - start
    written = [str(path) for path in (output, spectrum) if path is not None]
    data = {"output": written, "size": [width, height], "channels": channels, "dtype": str(source.array.dtype), "in_memory": whole,
            "ranks": comm.size, "seconds": took}  # fmt: skip
    console.result(data, f"{', '.join(written)}  ({width}x{height}, {_plural(shape[2], 'channel')}; {seconds(took)})")


def _help(comm: Comm, chosen: Filter | None, options: dict[str, Any]) -> None:
    """What ranks other than the first do: their part of what rank 0 says."""
    job = comm.share(None)
    if job == "whole":
        from luxel.cluster.fft import lowpass

        lowpass(None, None, comm, **options)
    elif job is not None:
        from luxel.filter.streamed import Job, filtered_bands

        for _ in filtered_bands(None, Job(**job, filter=chosen, **options), lambda done: None, comm.spread):  # type: ignore[arg-type]
            pass


def _plural(count: int, word: str) -> str:
    return f"{count} {word}{'s' * (count != 1)}"


def _in_memory(comm: Comm, source: Any, output: Path | None, spectrum: Path | None, chosen: Filter | None, options: dict[str, Any],
               threads: int) -> None:  # fmt: skip
    from luxel.cluster.fft import lowpass
    from luxel.filter.files import Sink, decoded

    linear = decoded(source.array, threads)
    filtered = None if chosen is None else lowpass(linear, chosen, comm, **options, threads=threads)
    if output is not None and filtered is not None:
        with Sink(output, source.array.shape, source.array.dtype, source.bits, threads) as sink:
            sink.write(filtered)
    if spectrum is not None:
        _write_spectrum(spectrum, linear, filtered, threads)


def _write_spectrum(path: Path, before: Array, after: Array | None, threads: int) -> None:
    """One spectrum, or two side by side on one scale."""
    import numpy as np

    from luxel.filter.spectrum import spectrum_picture
    from luxel.io.images import write_png

    picture, peak = spectrum_picture(before, threads=threads)
    if after is not None:
        bar = np.full((len(picture), 4), 255, np.uint8)
        picture = np.concatenate([picture, bar, spectrum_picture(after, peak, threads)[0]], 1)
    write_png(path, picture)


def _in_bands(comm: Comm, source: Any, output: Path, chosen: Filter, options: dict[str, Any], report: Any) -> None:
    from luxel.filter.files import Sink
    from luxel.filter.streamed import Job, filtered_bands

    shape = source.array.shape
    with Sink(output, shape, source.array.dtype, source.bits, options["threads"]) as sink:
        job = {"shape": shape, "dtype": sink.dtype, "memory": options.pop("memory"), "bands": _BANDS_EACH * comm.size if comm.size > 1 else 1}
        comm.share(job)
        for band in filtered_bands(source.array, Job(**job, filter=chosen, **options), report, comm.spread):
            sink.write(band)
