"""HDF5, which is read in a process of its own: what is broken in a file may end that one alone.

::

    reader: write_arrays ─► remote: Arrays ══ messages ══► child: Datasets ─► h5py
                                   ◄═══ rows, raw bytes ═══          origins

HDF5 itself ends the process, goes round for ever, or writes where it may not, at some files that
are damaged (`bfrt.formats.remote`).
"""
