"""luxel's filters beside SciPy and OpenCV, and its Fourier transforms beside ducc0: all in one run, in turns, medians.

    python benchmarks/filter.py                 # print
    python benchmarks/filter.py --write         # and put the tables into RESULTS.md
    python benchmarks/filter.py --calibrate     # the numbers of luxel.filter.cost for this machine

2000 x 2000 x 3 float32, mirrored borders where the peer has them. A peer that is not installed is named and left out. Each peer runs as it
comes, with as many threads as it takes; SciPy's FFT is given as many as luxel.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
import scipy.fft
import scipy.ndimage
import scipy.signal

from luxel.filter import cost, lowpass
from luxel.filter.antialias import decimate, weights
from luxel.filter.filters import make_filter, plans
from luxel.filter.transform import dft2, fft2
from report import alternating, machine, median, milliseconds, table, write_section

SIZE = 2000
Job = Callable[[], Any]


def optional(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        return None


def kernel(n: int) -> Any:
    weights = np.random.default_rng(n).random((n, n)).astype(np.float32)
    return weights / weights.sum()


def gaussian_jobs(image: Any, sigma: float, cv2: Any, threads: int) -> dict[str, Job]:
    taps = np.exp(-0.5 * (np.arange(-int(4 * sigma + 0.5), int(4 * sigma + 0.5) + 1) / sigma) ** 2)
    taps = (taps / taps.sum()).astype(np.float32)
    square = np.outer(taps, taps)[..., None]
    jobs: dict[str, Job] = {
        "luxel": partial(lowpass, image, gaussian=sigma, threads=threads),
        "SciPy gaussian_filter": partial(scipy.ndimage.gaussian_filter, image, sigma, axes=(0, 1)),
        "SciPy fftconvolve": with_workers(partial(scipy.signal.fftconvolve, image, square, "same", axes=(0, 1)), threads),
        "SciPy oaconvolve": with_workers(partial(scipy.signal.oaconvolve, image, square, "same", axes=(0, 1)), threads),
    }
    if cv2 is not None:
        jobs["OpenCV GaussianBlur"] = partial(cv2.GaussianBlur, image, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
        jobs["OpenCV sepFilter2D"] = partial(cv2.sepFilter2D, image, -1, taps, taps, borderType=cv2.BORDER_REFLECT)
    return jobs


def kernel_jobs(image: Any, n: int, cv2: Any, threads: int) -> dict[str, Job]:
    weights = kernel(n)
    jobs: dict[str, Job] = {
        "luxel": partial(lowpass, image, kernel=weights, threads=threads),
        "SciPy fftconvolve": with_workers(partial(scipy.signal.fftconvolve, image, weights[..., None], "same", axes=(0, 1)), threads),
        "SciPy oaconvolve": with_workers(partial(scipy.signal.oaconvolve, image, weights[..., None], "same", axes=(0, 1)), threads),
    }
    if cv2 is not None:
        jobs["OpenCV filter2D"] = partial(cv2.filter2D, image, -1, weights[::-1, ::-1].copy(), borderType=cv2.BORDER_REFLECT)
    return jobs


def with_workers(call: Job, threads: int) -> Job:
    def run() -> Any:
        with scipy.fft.set_workers(threads):
            return call()

    return run


def agree(jobs: dict[str, Job], reach: int) -> float:
    """The largest difference between luxel's picture and a peer's, away from the border (SciPy's FFTs have none but zeros)."""
    inside = slice(reach, -reach)
    own = jobs["luxel"]()[inside, inside]
    return max(float(np.abs(job()[inside, inside] - own).max()) for name, job in jobs.items() if name != "luxel")


def compare(cases: list[tuple[str, dict[str, Job], int]], repeats: int, slow: float = 1.0) -> list[list[str]]:
    """One row a case: luxel, the best peer and the best peer that uses FFTs, with the ratios. A job that takes longer than `slow` s runs once."""
    rows = []
    for name, jobs, reach in cases:
        apart = agree(jobs, reach)
        quick, times = {}, {}
        for job_name, job in jobs.items():
            start = time.perf_counter()
            job()
            took = time.perf_counter() - start
            (times if took > slow else quick)[job_name] = took if took > slow else job
        for job_name, taken in zip(quick, alternating(repeats, *quick.values()), strict=True):
            times[job_name] = median(taken)
        own = times.pop("luxel")
        best = min(times, key=lambda peer: times[peer])
        best_fft = min((peer for peer in times if "convolve" in peer), key=lambda peer: times[peer])
        rows.append([name, milliseconds(own), best, milliseconds(times[best]), f"{times[best] / own:.1f}x", milliseconds(times[best_fft]),
                     f"{times[best_fft] / own:.1f}x", f"{apart:.0e}"])  # fmt: skip
        print("  ".join(rows[-1]), "  ", ", ".join(f"{peer} {milliseconds(t)}" for peer, t in times.items()), flush=True)
    return rows


def transforms(repeats: int, threads: int) -> list[list[str]]:
    """SciPy's and ducc0's transforms of real and complex float32 planes, alone and two at once."""
    ducc0 = optional("ducc0")
    rows = []
    for n in (64, 256, 1000, 2000, 2048):
        plane = np.random.default_rng(n).random((n, n), np.float32)
        both = plane + 1j * plane
        jobs: list[Job] = [partial(scipy.fft.rfft2, plane, workers=threads), partial(scipy.fft.fft2, both, workers=threads),
                           partial(np.fft.fft2, both)]  # fmt: skip
        if ducc0 is not None:
            jobs += [partial(ducc0.fft.r2c, plane, nthreads=threads), partial(ducc0.fft.c2c, both, nthreads=threads)]
        times = [median(taken) for taken in alternating(repeats if n > 256 else 20 * repeats, *jobs)]
        shown = [milliseconds(t) for t in times] + ["–"] * (5 - len(times))
        rows.append([f"{n} x {n}", shown[0], shown[3], shown[1], shown[4], shown[2], f"{2 * times[0] / times[1]:.2f}x"])
        print("  ".join(rows[-1]), flush=True)
    return rows


def direct_transform(threads: int) -> list[list[str]]:
    rows = []
    for n in (16, 32, 64):
        plane = np.random.default_rng(n).uniform(0.1, 10, (n, n))
        slow = [min(t) for t in alternating(7 if n == 64 else 21, partial(dft2, plane, 1), partial(dft2, plane, threads))]
        fast = min(alternating(301, partial(fft2, plane, 1))[0])
        times = [milliseconds(slow[0]), milliseconds(slow[1]), f"{slow[0] / slow[1]:.2f}x", f"{1e6 * fast:.1f}"]
        rows.append([f"{n} x {n}", *times, f"{slow[0] / fast:,.0f}x"])
        print("  ".join(rows[-1]), flush=True)
    return rows


def calibrate() -> None:
    """Time every way on one thread, and print what `luxel.filter.cost` should hold."""
    image = np.random.default_rng(0).random((SIZE, SIZE, 3), np.float32)

    def nanoseconds(**options: Any) -> float:
        return 1e9 * median(alternating(5, partial(lowpass, image, threads=1, **options))[0])

    taps = {len(np.arange(-int(4 * s + 0.5), int(4 * s + 0.5) + 1)) * 2: nanoseconds(gaussian=s, method="separable") for s in (1, 3, 8, 20)}
    slope, base = np.polyfit(list(taps), [t / image.size for t in taps.values()], 1)
    print(f"_SEPARABLE = ({base:.2f}, {slope:.4f})")
    sizes = {n * n: nanoseconds(kernel=kernel(n), method="direct") for n in (3, 5, 7, 9, 11)}
    slope, base = np.polyfit(list(sizes), [t / image.size for t in sizes.values()], 1)
    print(f"_DIRECT = ({base:.2f}, {slope:.4f})")
    print(f"_DCT = {nanoseconds(gaussian=3.0, method='dct') / image.size / np.log2(SIZE**2):.2f}")
    print(f"_FFT = {nanoseconds(kernel=kernel(31), method='fft') / (SIZE + 30) ** 2 / 3.5 / np.log2((SIZE + 30.0) ** 2):.2f}")
    known = dict(cost._PAIR)
    for size in known:
        cost._PAIR, cost.SIZES = {size: known[size]}, (size,)
        kept, pairs = [], []
        for n in (size // 8 + 1, size // 4 + 1, size // 2 + 1):
            across = -(-SIZE // (size + 1 - n))
            kept.append((size + 1 - n) ** 2)
            pairs.append(nanoseconds(kernel=kernel(n), method="tiles") / (across * across * 3 / 2 + 0.5))
        slope, base = np.polyfit(kept, pairs, 1)
        print(f"_PAIR[{size}] = {base:.3g}, and {slope:.1f} a kept pixel", flush=True)


def decimation(repeats: int, threads: int) -> list[list[str]]:
    """What `render --aa lowpass` does to a picture drawn at n times the rate of 1920 x 1080, beside SciPy's polyphase filter of the same weights."""
    rows = []
    for rate in (2, 3, 4):
        image = np.random.default_rng(rate).random((1080 * rate, 1920 * rate, 4), np.float32)
        taps = weights(rate)
        reach = (len(taps) - rate) // 2 // rate
        whole = taps if len(taps) % 2 else np.append(taps, 0)  # SciPy's are centred on a sample

        def peer(image: Any = image, whole: Any = whole, rate: int = rate) -> Any:
            down = scipy.signal.resample_poly(image[rate // 2 - (rate % 2 == 0) :], 1, rate, axis=0, window=whole.astype(np.float32))
            return scipy.signal.resample_poly(down[:, rate // 2 - (rate % 2 == 0) :], 1, rate, axis=1, window=whole.astype(np.float32))

        job = partial(decimate, image, rate, threads=threads)
        inside = slice(reach + 1, -reach - 2)
        apart = float(np.abs(np.clip(peer(), image.min(), image.max())[inside, inside] - job()[inside, inside]).max())
        start = time.perf_counter()
        peer()
        slow = time.perf_counter() - start
        own = median(alternating(repeats, job)[0])
        rows.append([f"{rate} x {rate}", milliseconds(own), milliseconds(slow), f"{slow / own:.1f}x", f"{apart:.0e}"])
        print("  ".join(rows[-1]), flush=True)
    return rows


def chosen(options: dict[str, Any], threads: int) -> str:
    plan = plans(make_filter(**options), (SIZE, SIZE, 3), "mirror", threads)[0]
    return f"{plan.method}{f' of {plan.size}' if plan.size else ''}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--calibrate", action="store_true")
    parser.add_argument("--write", action="store_true", help="put the tables into RESULTS.md")
    options = parser.parse_args()
    if options.calibrate:
        calibrate()
        return
    cv2 = optional("cv2")
    peers = f"SciPy {scipy.__version__}, " + (f"OpenCV {cv2.__version__} ({cv2.getNumThreads()} threads)" if cv2 else "OpenCV missing")
    print(machine(), peers, sep="\n", flush=True)
    image = np.random.default_rng(0).random((SIZE, SIZE, 3), np.float32)
    cases = [(f"Gaussian, sigma {s} ({chosen({'gaussian': s}, options.threads)})", gaussian_jobs(image, s, cv2, options.threads), 4 * s + 1)
             for s in (1, 3, 8, 20)]  # fmt: skip
    cases += [(f"any kernel, {n} x {n} ({chosen({'kernel': kernel(n)}, options.threads)})", kernel_jobs(image, n, cv2, options.threads), n)
              for n in (3, 5, 7, 9, 15, 31, 101)]  # fmt: skip
    filters = table(["filter", "luxel, ms", "best peer", "ms", "ratio", "best FFT peer, ms", "ratio", "apart"], compare(cases, options.repeats))
    fast = table(["plane", "real, SciPy, ms", "real, ducc0, ms", "complex, SciPy, ms", "complex, ducc0, ms", "complex, NumPy, ms",
                  "two reals / one complex"], transforms(options.repeats, options.threads))  # fmt: skip
    lower = table(["rate", "luxel, ms", "SciPy resample_poly, ms", "ratio", "apart"], decimation(options.repeats, options.threads))
    direct = table(["plane", "direct, ms", f"{options.threads} threads, ms", "ratio", "FFT, us", "direct / FFT"], direct_transform(options.threads))
    text = f"""{machine()}. Peers: {peers}.

{SIZE} x {SIZE} x 3 float32, {options.threads} threads; medians of {options.repeats} runs in turns. Apart: largest difference to a peer, away
from the border.

{filters}

Transforms of float32, {options.threads} threads; the last column is what packing two real planes into one complex transform gains:

{fast}

Low-pass and decimation (`render --aa lowpass`), to 1920 x 1080 x 4 from a picture of so many times the rate:

{lower}

The paper's direct transform, double precision (best of 7 runs at least), beside the fast one on one thread (best of 301):

{direct}
"""
    print(text)
    if options.write:
        write_section("Filters", text)


if __name__ == "__main__":
    main()
