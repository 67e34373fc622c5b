"""Pictures: sums of light as rays bring it, finished rows, and files.

::

    light, first hits ─► Film: one band of rows ─► rows ─► ImageBuffer ─► Image ─► exr, png, npy
                           │                                  │
                      HeldFrame (frame): whole in memory, or band by band, the image on disk

Sums are whole numbers, so that no order of rays and no number of threads changes a bit.
"""
