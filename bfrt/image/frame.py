"""The memory of a frame: film and finished image whole, or one band of rows after another."""

from __future__ import annotations

from typing import NamedTuple

from bfrt.records import AOV_BYTES, FILM_BYTES, ON_REQUEST

#: A pixel of the finished image: R G B A, Z, N and the two halves of the id, 4 bytes each.
PIXEL_BYTES = 40

#: Bytes that a band of image rows takes while it is written, encoders' copies included.
IMAGE_BAND = 4 << 20

#: Rows that OpenEXR compresses together, and how often it has them: as they come, as they are put
#: together, and as they are compressed (measured, with rows of 2,000 to 65,535 pixels).
EXR_ROWS = 16
EXR_COPIES = 3

#: Of the memory that a frame may share: what a whole frame takes at the most, and a band of it.
FRAME_PART = 0.5
BAND_PART = 0.15

#: The part of a band of several views: many rows of few views would see as much of the scene.
VIEWS_PART = 0.3


class FrameSize(NamedTuple):
    """Holds a frame's size: pixels, samples of each, channels on request, and views.

    Several views of one size lie side by side: a row of the frame is that row of all of them.

    Attributes
    ----------
    width, height : int
        Pixels of a view; a width of 0 is no frame, but rays that somebody asks about.
    samples : int
        A pixel; 0 puts one at each pixel corner.
    aovs : tuple of str
        Which of `records.ON_REQUEST` it has.
    band : int
        Rows of each band, where a render that goes on has begun with them; 0 lets memory choose.
    views : int
    """

    width: int = 0
    height: int = 0
    samples: int = 1
    aovs: tuple[str, ...] = ()
    band: int = 0
    views: int = 1

    @property
    def across(self) -> int:
        """Return the film elements of a row: pixels of all views, or their corners."""
        return self.views * (self.width + (self.samples == 0))

    @property
    def elements(self) -> int:
        """Return the film elements of the whole frame."""
        return self.across * (self.height + (self.samples == 0))

    @property
    def extra(self) -> int:
        """Return the bytes that channels on request add to a film element, and to a pixel."""
        return sum(ON_REQUEST[name] for name in self.aovs)

    @property
    def image_bytes(self) -> int:
        """Return the bytes of the finished images, in memory or on disk."""
        return self.views * self.width * self.height * (PIXEL_BYTES + self.extra)

    @property
    def written_bytes(self) -> int:
        """Return the bytes that a writer of an image takes, when there is no film any more."""
        return EXR_ROWS * EXR_COPIES * self.width * (PIXEL_BYTES + self.extra) + IMAGE_BAND

    def band_bytes(self, rows: int) -> int:
        """Return the bytes of the film of a band of rows, while the image is on disk."""
        corners = self.samples == 0
        return self.across * (rows + corners) * (FILM_BYTES + AOV_BYTES + self.extra) + IMAGE_BAND

    @property
    def whole_bytes(self) -> int:
        """Return the bytes of the film, or then of a writer, and of the image made from it."""
        return max(self.band_bytes(self.height), self.written_bytes) + self.image_bytes


class HeldFrame(NamedTuple):
    """Tells how much of a frame is in memory: `rows` at a time, which take `bytes`."""

    rows: int
    bytes: int
    on_disk: bool


def held_frame(frame: FrameSize, room: int, fewest: int) -> HeldFrame:
    """Choose how a frame is held: whole where that takes no more than its part of the room.

    Parameters
    ----------
    room : int
        Bytes that it shares.
    fewest : int
        Pixels of a band of rows at the least.
    """
    if not frame.width:
        return HeldFrame(0, 0, on_disk=False)
    whole = frame.whole_bytes
    if whole <= room * FRAME_PART and frame.band in (0, frame.height):
        return HeldFrame(frame.height, whole, on_disk=False)
    if frame.band:
        return HeldFrame(frame.band, frame.band_bytes(frame.band), on_disk=True)
    first = frame.band_bytes(1)
    row = frame.band_bytes(2) - first
    part = BAND_PART if frame.views == 1 else VIEWS_PART
    fits = int((room * part - first) / row) + 1
    rows = min(frame.height, max(fits, -(-fewest // (frame.views * frame.width))))
    if frame.views > 1:  # bands alike: what the last one would leave free is for rays
        rows = -(-frame.height // -(-frame.height // rows))
    taken = max(frame.band_bytes(rows), frame.written_bytes)
    return HeldFrame(rows, taken, on_disk=True)
