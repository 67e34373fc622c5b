"""How many candidates a ray gets in a pass."""

from hypothesis import given
from hypothesis import strategies as st

from bfrt.phases.traversal import BYTES_EACH, FIRST_QUOTA, LEAP, quota

ROOM = 1 << 40


def test_twice_as_many_in_each_pass():
    assert quota(FIRST_QUOTA, 0, 1000, ROOM, selective=True) == FIRST_QUOTA
    assert quota(8, BYTES_EACH * 1000 * 7, 1000, ROOM, selective=False) == 8


def test_as_many_as_a_pass_is_worth():
    assert quota(2, BYTES_EACH * 1000 * 7, 1000, ROOM, selective=True) == 7
    assert quota(2, BYTES_EACH * 1000 * 7000, 1000, ROOM, selective=False) == 7000


def test_few_rays_do_not_leap_where_reading_follows_them():
    assert quota(2, BYTES_EACH * 1000 * 7000, 1000, ROOM, selective=True) == 2 * LEAP


@given(
    least=st.integers(1, 1 << 20),
    read=st.integers(0, 1 << 50),
    rays=st.integers(1, 1 << 30),
    each=st.integers(1, 1 << 20),
    selective=st.booleans(),
)
def test_memory_holds_them(least, read, rays, each, selective):
    room = each * rays + rays - 1
    assert 1 <= quota(least, read, rays, room, selective=selective) <= each
