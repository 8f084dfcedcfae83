"""The metrics of every figure in this project: one exposure for a capture, display values, then PSNR, SSIM and FLIP.

Reference values are the held-out photographs' pixels that hit the geometry and pass the mask. Their 99.5th percentile
shows as white; values are clipped to [0, 1] and pass the sRGB curve. Outside of these pixels both pictures are made
black, so that what is not modelled (a cloth, a wall) reaches no window of SSIM or FLIP; the maps are then averaged
over these pixels alone. The relative error is on linear radiance.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass

import flip_evaluator
import numpy as np
from jaxtyping import Bool, Float
from skimage.metrics import structural_similarity

from relight3d.errors import InputError
from relight3d.maths.color import exposure_of, srgb_from_linear

PSNR_CEILING_DB = 100.0  # equal pictures: a finite figure, so that a mean over frames stays one
SSIM_WINDOW = 7  # scikit-image's own


@dataclass(frozen=True)
class FrameMetrics:
    """The figures of one frame, or their means over `num_frames` frames."""

    name: str
    group: str
    num_pixels: int
    psnr_db: float
    ssim: float
    flip: float
    relative_rmse: float
    num_frames: int = 1


@dataclass(frozen=True)
class Metrics:
    """The figures of a capture's held-out frames, and of one method."""

    frames: tuple[FrameMetrics, ...]

    @property
    def mean(self) -> FrameMetrics:
        """The capture's figure: the mean over its frames."""
        return _mean("mean", "", self.frames)

    @property
    def worst(self) -> FrameMetrics:
        """The frame with the lowest PSNR."""
        return min(self.frames, key=lambda frame: frame.psnr_db)

    @property
    def groups(self) -> Mapping[str, FrameMetrics]:
        """Means per group of frames, in the order of their first frame."""
        names = dict.fromkeys(frame.group for frame in self.frames)
        return {name: _mean(name, name, [f for f in self.frames if f.group == name]) for name in names}

    def only(self, names: Iterable[str]) -> "Metrics":
        """The same figures over some of the frames: to compare methods over frames that both can do."""
        wanted = set(names)
        return Metrics(tuple(frame for frame in self.frames if frame.name in wanted))

    def to_dict(self) -> dict:
        return {
            "mean": asdict(self.mean),
            "worst": asdict(self.worst),
            "groups": {name: asdict(mean) for name, mean in self.groups.items()},
            "frames": [asdict(frame) for frame in self.frames],
        }

    def rows(self) -> list[FrameMetrics]:
        """The lines of a table: each frame, each group where there are several, and the mean."""
        groups = list(self.groups.values())
        return [*self.frames, *(groups if len(groups) > 1 else []), self.mean]


def capture_exposure(
    references: Sequence[Float[np.ndarray, "... 3"]], masks: Sequence[Bool[np.ndarray, "..."]]
) -> float:
    """The factor that shows the 99.5th percentile of all reference values, of all frames and channels, as white."""
    return exposure_of(np.concatenate([image[mask].ravel() for image, mask in zip(references, masks, strict=True)]))


def display_values(radiance: Float[np.ndarray, "*axes 3"], exposure: float) -> Float[np.ndarray, "*axes 3"]:
    """What a screen shows, in [0, 1]: exposed, clipped, on the sRGB curve."""
    return srgb_from_linear(np.asarray(radiance, np.float32) * np.float32(exposure))


def psnr_db(got: Float[np.ndarray, "*axes"], reference: Float[np.ndarray, "*axes"]) -> float:
    """Peak signal-to-noise ratio of display values, peak 1; at most PSNR_CEILING_DB."""
    mean_square = float(np.mean(np.square(np.asarray(got, np.float64) - reference)))
    return -10.0 * float(np.log10(max(mean_square, 10.0 ** (-PSNR_CEILING_DB / 10.0))))


def relative_rmse(got: Float[np.ndarray, "*axes"], reference: Float[np.ndarray, "*axes"], floor: float) -> float:
    """Root mean square error over the reference's root mean square, which counts as at least `floor`."""
    error = np.sqrt(np.mean(np.square(np.asarray(got, np.float64) - reference)))
    return float(error / max(np.sqrt(np.mean(np.square(np.asarray(reference, np.float64)))), floor))


def ssim_map(
    got: Float[np.ndarray, "height width 3"], reference: Float[np.ndarray, "height width 3"]
) -> Float[np.ndarray, "height width"]:
    """Structural similarity of display values at each pixel, mean of the channels (Wang et al. 2004, scikit-image)."""
    height, width = got.shape[:2]
    # A window of one pixel has no variance: a picture of one or two pixels a side is doubled at its edge until it has three.
    edge = [(0, max(0, 3 - height)), (0, max(0, 3 - width)), (0, 0)]
    got, reference = (np.pad(picture, edge, mode="symmetric") for picture in (got, reference))
    shortest = min(got.shape[:2])
    window = min(SSIM_WINDOW, shortest - 1 + shortest % 2)  # odd, and within the picture
    answer = structural_similarity(reference, got, win_size=window, data_range=1.0, channel_axis=-1, full=True)
    return np.mean(answer[-1], axis=-1)[:height, :width]


def flip_map(
    got: Float[np.ndarray, "height width 3"], reference: Float[np.ndarray, "height width 3"]
) -> Float[np.ndarray, "height width"]:
    """The difference a viewer sees when the two pictures alternate, at each pixel (Andersson et al. 2020)."""
    error, _, _ = flip_evaluator.evaluate(
        np.ascontiguousarray(reference), np.ascontiguousarray(got), "LDR", applyMagma=False, computeMeanError=False
    )
    return error.reshape(got.shape[:2])


def measure_frame(
    name: str,
    got: Float[np.ndarray, "height width 3"],
    reference: Float[np.ndarray, "height width 3"],
    mask: Bool[np.ndarray, "height width"],
    exposure: float,
    group: str = "",
) -> FrameMetrics:
    """The figures of one frame over the mask's pixels.

    Raises InputError where the mask is empty or a value under it is not finite: an error map with a hole in it
    would report a frame as better than it is.
    """
    if not mask.any():
        raise InputError(f"frame {name}", "no pixel", "a pixel that hits the mesh and passes the mask")
    for what, image in (("rendered radiance", got), ("photograph", reference)):
        num_bad = int((~np.isfinite(image[mask])).any(axis=-1).sum())
        if num_bad:
            raise InputError(f"frame {name}: {what}", f"{num_bad} pixels with NaN or infinity", "finite values")
    shown, wanted = (display_values(np.where(mask[..., None], image, 0.0), exposure) for image in (got, reference))
    return FrameMetrics(
        name=name,
        group=group,
        num_pixels=int(mask.sum()),
        psnr_db=psnr_db(shown[mask], wanted[mask]),
        ssim=float(ssim_map(shown, wanted)[mask].mean()),
        flip=float(flip_map(shown, wanted)[mask].mean()),
        # A frame darker than a thousandth of white is measured against that.
        relative_rmse=relative_rmse(got[mask], reference[mask], floor=1e-3 / exposure),
    )


def _mean(name: str, group: str, frames: Sequence[FrameMetrics]) -> FrameMetrics:
    def mean_of(figure: str) -> float:
        return float(np.mean([getattr(frame, figure) for frame in frames]))

    return FrameMetrics(
        name=name,
        group=group,
        num_pixels=sum(frame.num_pixels for frame in frames),
        psnr_db=mean_of("psnr_db"),
        ssim=mean_of("ssim"),
        flip=mean_of("flip"),
        relative_rmse=mean_of("relative_rmse"),
        num_frames=len(frames),
    )
