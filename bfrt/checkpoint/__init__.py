"""Checkpoints: the state of work that takes long, on disk, from which a killed run goes on.

::

    Checkpoint        the folder that a caller names: when to save, which generation counts
        │
        ├─ Identity       what is done, of which scene, with which settings: another is refused
        ├─ StateWriter    writes a generation: a file for each array, then the header
        └─ SavedState     reads one, whose checksums have been compared
              └─ Sound    nothing in it leads outside of what there is

A generation is a folder, complete or not there::

    DIR/state.7.part/     while it is written; every file is synced, then the folder
    DIR/state.7/          renamed, and DIR synced; then the generation before is removed
        rays  paths ...   records, little-endian, as bfrt/records.py declares them
        state.json        identity, facts, and of each file its bytes and CRC-32
"""
