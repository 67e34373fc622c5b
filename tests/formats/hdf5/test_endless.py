"""A damaged file in which HDF5 goes round for ever: the system ends the process that reads it."""

from __future__ import annotations

import base64
import json
import signal
import subprocess
import sys
import zlib

import pytest

from bfrt.errors import SceneError
from bfrt.formats.hdf5.origins import Limits
from bfrt.formats.hdf5.remote import HDF5, RemoteArrays
from bfrt.formats.remote.process import SERVE
from bfrt.formats.remote.serving import SECONDS

pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")

#: What fuzzing found: groups as of openPMD with flipped bytes, and zeros that change nothing.
ENDLESS = (
    "c-rmNy-EW?5C`zt5Ah5H5)l$?ywXav5L+d=m_m#sDJ%^rD1s-"
    "KfTgXzfZ!YWD85y^xt+zmEd_<(|JMw&JDCk(cJn&y51Nhb2C*a|ODzg51$CobTuD?CUnG8Lzpko1`8c(ue_S^mXB"
    "k&7BmSIy>taIi9}TmU3yznP`+54*^}1f37uR<Wv&GH4HkZdgJXg`W>!EzU>!NlGTT*8v#<?lKDOa}B9daX_QYWF#"
    "v+S>x_ks7d(aHwr+H%rW75&`1dt;5i0`B}xNjV$5HSfQFq2Dn%ANBc0`+Jxg%qGC9I_-"
    "_ls+Xiy{~v$%1^#_~oE3|s+e0eyr+M|dsi2Dv@@|x~4O!zR2YX=`00000000000D!;u1?_x2H~"
)


def test_a_file_in_which_hdf5_goes_round(file):
    file.write_bytes(zlib.decompress(base64.b85decode(ENDLESS)))
    with pytest.raises(SceneError) as caught:
        RemoteArrays(str(file), (0, 1 << 30, False, 1))
    assert str(caught.value) == (
        f"{file}: found what ends HDF5 itself (status {-signal.SIGXCPU}), expected datasets that "
        "are whole"
    )


def test_it_goes_round_without_a_limit(file):
    """Or the test above tells nothing."""
    file.write_bytes(zlib.decompress(base64.b85decode(ENDLESS)))
    work = [
        sys.executable,
        "-c",
        SERVE,
        json.dumps([str(file), [0, 1 << 30, False, 60]]),
        HDF5.module,
        *sys.path,
    ]
    with pytest.raises(subprocess.TimeoutExpired):
        subprocess.run(work, timeout=5, check=False, capture_output=True)


def test_an_answer_may_take_minutes():
    assert Limits(0, 0).seconds == SECONDS >= 300
