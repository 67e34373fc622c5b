"""HDF5, which is read in a process of its own: what is broken in a file may end that one alone.

::

    reader: write_arrays ─► remote: Arrays ══ messages ══► child: Datasets ─► h5py
                                   ◄═══ rows, raw bytes ═══          origins

HDF5 itself ends the process, goes round for ever, or writes where it may not, at some files that
are damaged. The system ends a child that has had the processor for minutes for one answer. The
child has no more to do than `bfrt.formats.hdf5.messages` can ask for, and ends when its pipe is
closed.
"""
