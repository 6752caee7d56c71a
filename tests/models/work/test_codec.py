"""Encoded values come back exactly, equal ones give equal bytes, and what is torn or foreign is refused."""

from __future__ import annotations

import enum
import math
import os
import struct
import subprocess
import sys
import tracemalloc
from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from google_crc32c import value as crc32c
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from models.machine.scene import Defect, Scene, Slip
from models.work.codec import MAX_DEPTH, DamagedDataError, decode, digest, encode, name_of, resolve

NAN_WITH_PAYLOAD = struct.unpack("<d", bytes.fromhex("010000000000f87f"))[0]


class Colour(enum.Enum):
    RED = 1


class Pair(NamedTuple):
    first: object
    second: object


@dataclass(frozen=True)
class Plan:
    name: str
    values: Any = None
    made: int = field(default=0, init=False)

    def __post_init__(self):
        object.__setattr__(self, "made", self.made + 1)

    @cached_property
    def doubled(self):
        return self.name * 2


@dataclass(slots=True)
class Slotted:
    number: float
    later: int = field(init=False)


def same(one: Any, other: Any) -> bool:
    """Return whether two values are equal in type and in each bit."""
    if type(one) is not type(other):
        return False
    if isinstance(one, float):
        return struct.pack("<d", one) == struct.pack("<d", other)
    if isinstance(one, np.ndarray):
        flags = [(a.flags.c_contiguous, a.flags.f_contiguous, a.flags.writeable, a.dtype.str) for a in (one, other)]
        return one.shape == other.shape and flags[0] == flags[1] and one.tobytes() == other.tobytes()
    if isinstance(one, np.generic):
        return one.dtype == other.dtype and one.tobytes() == other.tobytes()
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return same(list(one.items()), list(other.items()))
    return one == other


plain = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(width=64)
    | st.complex_numbers()
    | st.text()
    | st.binary()
    | st.sampled_from([NAN_WITH_PAYLOAD, -0.0, 2**200, -(2**63), Path("a/ü"), Colour.RED, "\udc80", np.str_(""), b""])
)
dtypes = hnp.boolean_dtypes() | hnp.integer_dtypes(endianness="=") | hnp.floating_dtypes(sizes=(16, 32, 64))
arrays = hnp.arrays(dtypes | hnp.unicode_string_dtypes(max_len=3), hnp.array_shapes(min_dims=0, max_side=4, min_side=0))
scalars = hnp.from_dtype(np.dtype(np.float32)) | hnp.from_dtype(np.dtype("M8[ns]")) | hnp.from_dtype(np.dtype("?"))
values = st.recursive(
    plain | arrays | scalars | st.frozensets(st.integers() | st.text()) | st.sets(st.binary()),
    lambda inner: (
        st.lists(inner)
        | st.tuples(inner, inner)
        | st.dictionaries(st.text() | st.integers(), inner)
        | st.builds(Pair, inner, inner)
    ),
    max_leaves=8,
)


@given(values)
def test_a_value_comes_back_exactly_and_again_as_the_same_bytes(value):
    data = encode(value)
    back = decode(data)
    assert same(back, value)
    assert encode(back) == data


@given(values, st.data())
def test_torn_and_changed_bytes_are_found(value, data):
    whole = encode(value)
    place = data.draw(st.integers(0, len(whole) - 1))
    changed = bytearray(whole)
    changed[place] ^= data.draw(st.integers(1, 255))
    for damaged in (whole[:place], bytes(changed)):
        with pytest.raises(DamagedDataError):
            decode(damaged)


@given(values, st.data())
def test_bytes_with_a_right_checksum_are_a_value_or_refused(value, data):
    """What writes into the store of the chunks may write a right checksum, too."""
    body = bytearray(encode(value)[8:])
    for _ in range(data.draw(st.integers(1, 3))):
        body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    with suppress(DamagedDataError):
        decode(b"SWC1" + struct.pack("<I", crc32c(bytes(body))) + bytes(body))


@pytest.mark.parametrize(
    "body",
    [
        b"a" + struct.pack("<Q", 3) + b"<f8" + b"Cw\x01" + struct.pack("<QQ", 2**40, 0),
        b"a" + struct.pack("<Q", 2) + b"|O" + b"Cw\x01" + struct.pack("<QQ", 1, 8) + bytes(8),
        b"a" + struct.pack("<Q", 3) + b"<f8" + b"Cw\x02" + struct.pack("<QQQ", 3, 5, 8) + bytes(8),
        (b"l" + struct.pack("<Q", 1)) * 100_000 + b"N",
        b"d" + struct.pack("<Q", 1) + b"l" + bytes(8) + b"N",
        b"E" + struct.pack("<Q", 28) + b"models.machine.scene:Nothing" + bytes(8),
        b"s" + struct.pack("<Q", 1) + b"\xff",
        b"b" + struct.pack("<Q", 2**63),
        b"l" + struct.pack("<Q", 2**63),
    ],
    ids=["a bomb", "objects", "another shape", "too deep", "a key", "no member", "no text", "too long", "too many"],
)
def test_hostile_bytes_are_refused_without_the_memory_that_they_state(body):
    tracemalloc.start()
    try:
        with pytest.raises(DamagedDataError):
            decode(b"SWC1" + struct.pack("<I", crc32c(body)) + body)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("order", ["C", "F"])
def test_the_order_in_memory_and_the_right_to_write_are_kept(order):
    # Sums depend on the order, numba's types on both.
    array = np.asarray(np.arange(6.0).reshape(2, 3), order=order)
    array.flags.writeable = False
    back = decode(encode(array))
    assert (back.flags.c_contiguous, back.flags.writeable, back.flags.aligned) == (order == "C", False, True)
    assert decode(encode(np.arange(6.0)[::2])).strides == (8,)


def test_the_byte_order_is_kept():
    assert decode(encode(np.array([1, 2], ">i4"))).dtype.str == ">i4"


def test_fields_are_set_without_the_constructor():
    plan = Plan("a", np.arange(3.0))
    assert plan.doubled == "aa"
    back = decode(encode(plan))
    assert (back.name, back.made, back.doubled) == ("a", 1, "aa")
    slotted = Slotted(math.pi)
    back = decode(encode(slotted))
    assert back.number == math.pi
    assert not hasattr(back, "later")


def test_a_scene_is_encoded():
    scene = Scene(40.0, 4000.0, defect=Defect(0.1, 1e-5), slip=Slip(0.01))
    assert decode(encode(scene)) == scene


class Plain:
    pass


@dataclass
class Hides:
    number: int

    def __post_init__(self):
        self.hidden = 1


LOCAL_NAME = "test_what_cannot_be_sent_is_refused_by_its_place"


def test_what_cannot_be_sent_is_refused_by_its_place():
    @dataclass
    class Local:
        number: int

    nested: list[Any] = []
    for _ in range(MAX_DEPTH + 2):
        nested = [nested]
    cases = {
        "value[1]['a'].values: tests.models.work.test_codec.Plain": (1, {"a": Plan("", Plain())}),
        "value: builtins.function": lambda: 1,
        "value: collections.OrderedDict": OrderedDict(a=1),
        "value: Hides holds 'hidden'": Hides(1),
        f"value: tests.models.work.test_codec:{LOCAL_NAME}": Local(1),
        "value.first: values of the type object": Pair(np.array([None]), 1),
        "value: values of the type float128": np.longdouble(1),
        "value: values of the type [('a'": np.zeros(1, [("a", "f8")]),
        "value: numpy.ma": np.ma.zeros(2),
        "an item of value: builtins.range": {range(3)},
        "key range(0, 3) of value: builtins.range": {range(3): 1},
        "more than 100 levels": nested,
    }
    for words, value in cases.items():
        with pytest.raises(TypeError) as error:
            encode(value)
        assert words in str(error.value)


def test_foreign_names_are_refused_on_reading():
    for name in ("os:system", "models.machine.scene:Nothing", "models.nothing:A", "models.machine.scene"):
        with pytest.raises(DamagedDataError):
            resolve(name)
    assert resolve(name_of(Plan)) is Plan
    with pytest.raises(TypeError, match="os"):
        name_of(os.getcwd)
    # A class that is no dataclass is not made.
    hostile = encode(Plan("a")).replace(b":Plan", b":Plain"[:5])
    with pytest.raises(DamagedDataError):
        decode(hostile)


def test_a_digest_is_that_of_the_value():
    assert digest((1, 2.0)) == digest((1, 2.0))
    different = [(1, 2.0), [1, 2.0], (1, 2), (True, 2.0), ("1", 2.0), (1, -2.0), (1, 2.0, None), np.array([1, 2.0])]
    assert len({digest(value) for value in different}) == len(different)
    assert digest(0.0) != digest(-0.0)


@pytest.mark.process
def test_digests_are_the_same_in_processes_of_other_hash_seeds():
    code = (
        "from models.machine.scene import *; from models.work.codec import digest;"
        "print(digest((Scene(40.0, 4e3, slip=Slip(0.01)), frozenset('abcdefgh'), {'z': {'x', 'y', 'w'}, 'a': None})))"
    )
    environments = [os.environ | {"PYTHONHASHSEED": seed} for seed in ("1", "2")]
    runs = [
        subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True)
        for environment in environments
    ]
    found = [run.communicate()[0] for run in runs]
    value = (Scene(40.0, 4e3, slip=Slip(0.01)), frozenset("abcdefgh"), {"z": {"x", "y", "w"}, "a": None})
    assert found == [digest(value) + "\n"] * 2
