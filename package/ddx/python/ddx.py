# SPDX-License-Identifier: LGPL-2.1-or-later
"""The DDX store for Python: libddx through ctypes, frames as numpy arrays without a copy.

    import ddx
    with ddx.Store() as store, store.item("video") as item:      # or ddx.Store("carol"), another machine's
        for frame in item.frames(timeout=1.0):
            print(frame.sequence, frame.time, frame.missed, frame["y"].mean())

ddx.h is the manual of the library; tails, times (int ns, CLOCK_MONOTONIC) and rules are the same. Failures raise
ddx.Error (an OSError with errno and the library's text), timeouts raise TimeoutError. A handle belongs to one thread.

Two times: frame.time is when a frame was written, for ages and latencies; frame["time"] of a video item is when its
picture was captured. Write values computed from a picture with the latter, so that log and recording agree:
item.write({...}, time=frame["time"]).
"""
from __future__ import annotations

import ctypes
import dataclasses
import errno
import pathlib
import sysconfig
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np

CURRENT, NEXT, IN_ORDER = 0, 1, -1  # enum ddx_tail
INT, UNSIGNED, FLOAT, CHAR, STRUCT = range(1, 6)  # enum ddx_kind
AnyItem = TypeVar("AnyItem", bound="Item")
_TEXT_MAX = 4096  # longer arrays of char are pictures
_FIRST_WAIT = 1.0  # s, for the first value of another machine
_SLICE = 0.2  # s; waits are split into slices, so that Ctrl-C works


class Error(OSError):
    """An error of libddx."""


def _library_file() -> str:
    """In a prefix that the dynamic linker does not search, libddx is in a library folder above this module."""
    name, system = "libddx.so.0", sysconfig.get_config_var("MULTIARCH") or "."
    for folder in pathlib.Path(__file__).resolve().parents:
        for found in (folder / system / name, folder / name):
            if found.exists():
                return str(found)
    return name


@dataclasses.dataclass(frozen=True)
class Field:
    """One field of an item's type, see struct ddx_field."""
    name: str
    kind: int
    bytes: int
    count: int
    offset: int
    used: int
    children: int


class _CField(ctypes.Structure):
    _fields_ = [("name", ctypes.c_char_p), ("kind", ctypes.c_int), ("bytes", ctypes.c_uint32),
                ("count", ctypes.c_uint32), ("offset", ctypes.c_uint64), ("used", ctypes.c_uint64),
                ("children", ctypes.c_uint32)]


class _CFrame(ctypes.Structure):
    _fields_ = [("data", ctypes.c_void_p), ("time", ctypes.c_int64), ("sequence", ctypes.c_uint64),
                ("missed", ctypes.c_uint64)]


class _CExtent(ctypes.Structure):
    _fields_ = [("field", ctypes.c_char_p), ("bytes", ctypes.c_size_t)]


class _CSpec(ctypes.Structure):
    _fields_ = [("name", ctypes.c_char_p), ("type", ctypes.c_char_p), ("declaration", ctypes.c_char_p),
                ("size", ctypes.c_size_t), ("extents", ctypes.POINTER(_CExtent)), ("extent_count", ctypes.c_uint)]


_library = ctypes.CDLL(_library_file(), use_errno=True)


def _function(name: str, result: Any, *arguments: Any) -> Any:
    function = getattr(_library, name)
    function.restype, function.argtypes = result, arguments
    return function


_P, _I, _S, _D = ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_double
_TIME = ctypes.POINTER(ctypes.c_int64)
_open = _function("ddx_store_open", _P, _S, _I, _D)
_close = _function("ddx_store_close", _I, _P)
_lookup = _function("ddx_store_lookup_item", _P, _P, _S, _S, _I)
_await = _function("ddx_store_await_item", _P, _P, _S)
_create = _function("ddx_store_create", _I, _P, ctypes.POINTER(_CSpec), ctypes.POINTER(_P))
_done = _function("ddx_store_done_item", _I, _P)
_acquire = _function("ddx_store_acquire", _I, _P, ctypes.POINTER(_CFrame), _D, _I)
_release = _function("ddx_store_release", _I, _P)
_keep = _function("ddx_store_keep", _I, _P, ctypes.c_uint)
_loan = _function("ddx_store_loan", _I, _P, ctypes.POINTER(_P))
_publish = _function("ddx_store_publish", _I, _P, _TIME)
_cancel = _function("ddx_store_cancel", _I, _P)
_field = _function("ddx_store_field", ctypes.POINTER(_CField), _P, ctypes.c_uint)
_item_name = _function("ddx_store_item_name", _S, _P)
_type = _function("ddx_store_item_type", _S, _P)
_missed = _function("ddx_store_missed", ctypes.c_uint64, _P)
_text = _function("ddx_error_text", _S, _I)
_problem = _function("ddx_type_problem", _I, _S, ctypes.c_char_p, ctypes.c_size_t)
time_now = _function("ddx_time_now", ctypes.c_int64)


def _check(result: int) -> None:
    if result == -110:  # ETIMEDOUT
        raise TimeoutError(-result, _text(result).decode())
    if result < 0:
        raise Error(-result, _text(result).decode())


def _typed(where: str, **arguments: tuple[Any, type | tuple[type, ...], str]) -> None:
    """TypeError with the argument's name; ctypes would give its number only."""
    for name, (value, kind, wanted) in arguments.items():
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise TypeError(f"{where}: {name} is {wanted}, not {value!r}")


class Store:
    """A connection to this machine's store, or through its catalog to that of the machine `host`: there, item("gps")
    is this machine's item "carol:gps". timeout: seconds to wait for the store, and for the machine to be heard."""

    def __init__(self, host: str | None = None, port: int = 0, timeout: float = 1.0) -> None:
        self._handle: int | None = None
        self._items: list[Item] = []
        _typed("Store()", host=(host, (str, type(None)), "a machine's name"), port=(port, int, "a number"),
               timeout=(timeout, (int, float), "a number of seconds"))
        self._handle = _open(None if host is None else host.encode(), port, timeout)
        if not self._handle:
            _check(-ctypes.get_errno())

    def item(self, name: str, awaited: bool = False) -> Item:
        """Open an existing item for reading or writing; awaited: for reading, also before the item exists."""
        _typed("item()", name=(name, str, "an item's name"))
        open_handle = self._open_handle()
        handle = _await(open_handle, name.encode()) if awaited else _lookup(open_handle, name.encode(), None, 0)
        if not handle:
            _check(-ctypes.get_errno())
        return Item(self, name, handle)

    def create(self, name: str, type: str, declaration: str, extents: Mapping[str, int] | None = None) -> Item:
        """Create an item, or take it over from a writer that has exited: "struct { int a; char b[64]; }"."""
        return self.create_as(Item, name, type, declaration, extents)

    def create_as(self, handle_class: Callable[[Store, str, int], AnyItem], name: str, type: str, declaration: str,
                  extents: Mapping[str, int] | None = None) -> AnyItem:
        """As create(), for a handle of a class derived from Item."""
        _typed("create()", name=(name, str, "an item's name"), type=(type, str, "a type's name"),
               declaration=(declaration, str, "a struct in C"))
        used = [_CExtent(field.encode(), count) for field, count in (extents or {}).items()]
        spec = _CSpec(name.encode(), type.encode(), declaration.encode(), 0, (_CExtent * len(used))(*used), len(used))
        problem = ctypes.create_string_buffer(256)
        if _problem(declaration.encode(), problem, len(problem)) == -errno.EINVAL:
            raise Error(errno.EINVAL, f"{name}: {problem.value.decode()}")
        handle = _P()
        _check(_create(self._open_handle(), ctypes.byref(spec), ctypes.byref(handle)))
        assert handle.value
        return handle_class(self, name, handle.value)

    def _open_handle(self) -> int:
        if not self._handle:
            raise ValueError("the store is closed")
        return int(self._handle)

    def close(self) -> None:
        for item in list(self._items):
            item.close()
        if self._handle:
            _close(self._handle)
            self._handle = None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class View(np.ndarray[Any, Any]):
    """An array in a held frame. Its use after the frame's release raises ValueError; copies are independent. (Arrays
    that np.asarray() or another library made of it are not checked.)"""
    _memory: _Memory | None = None

    def __array_finalize__(self, source: Any) -> None:
        self._memory = None if self.flags.owndata else getattr(source, "_memory", None)

    def __getitem__(self, key: Any) -> Any:
        _plain(self)
        return super().__getitem__(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        _plain(self)[key] = value

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = (), **options: Any) -> Any:
        if out:
            options["out"] = tuple(map(_plain, out))
        return getattr(ufunc, method)(*map(_plain, inputs), **options)

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        for value in [*arguments, *options.values()]:
            for part in value if isinstance(value, (list, tuple)) else [value]:
                _plain(part)
        return super().__array_function__(function, types, arguments, options)


def _watched(name: str) -> Any:
    def method(self: View, *arguments: Any, **options: Any) -> Any:
        return getattr(_plain(self), name)(*arguments, **options)
    return method


for _name in "argmax argmin astype copy dot item nonzero take tobytes tofile tolist".split():
    setattr(View, _name, _watched(_name))


def _plain(value: Any) -> Any:
    """The value as an unchecked array; ValueError if its frame was released."""
    if isinstance(value, View):
        if value._memory is not None and not value._memory.address:
            raise ValueError("a view of a frame that was released; copy the data before the release")
        return value.view(np.ndarray)
    return value


def _dtype(fields: list[Field], i: int) -> tuple[np.dtype[Any], int]:
    """The dtype of one element of the i-th field, and the number of fields that belong to it."""
    field = fields[i]
    if field.kind != STRUCT:
        letter = {INT: "i", UNSIGNED: "u", FLOAT: "f", CHAR: "u"}[field.kind]
        return np.dtype(f"{letter}{field.bytes}"), 1
    names, formats, offsets = [], [], []
    k = i + 1
    while k <= i + field.children:
        inner, step = _dtype(fields, k)
        shape = (fields[k].count,) if fields[k].count > 1 else ()
        names.append(fields[k].name.rpartition(".")[2])
        formats.append((inner, shape))
        offsets.append(fields[k].offset - field.offset)
        k += step
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": field.bytes}), k - i


def _inner(fields: list[Field], outer: str) -> dict[str, Field]:
    """The fields just inside a struct, or the outermost ones, by their short names."""
    begin = outer + "." if outer else ""
    return {f.name[len(begin):]: f for f in fields if f.name.startswith(begin) and "." not in f.name[len(begin):]}


class _Memory:
    """A frame in memory: frame["y"] is a view of a field (or a number), frame.value() a copy of the whole value."""

    def __init__(self, item: Item, address: int, writable: bool) -> None:
        self.item, self.address, self.writable = item, address, writable
        self.fields = item.fields  # a new writer may have changed them, so each frame has its own
        self.outer = _inner(self.fields, "")

    def view(self, name: str) -> np.ndarray[Any, Any]:
        """A view of a field, also of a single number."""
        if not self.address:
            raise ValueError("a frame that was released")
        field = self._field(name)
        dtype, _ = _dtype(self.fields, self.fields.index(field))
        memory = (ctypes.c_char * field.used).from_address(self.address + field.offset)
        buffer = memoryview(memory) if self.writable else memoryview(memory).toreadonly()
        shape = () if field.count == 1 and field.used else (field.used // field.bytes,)
        array = np.frombuffer(buffer, dtype).reshape(shape).view(View)
        array._memory = self
        return array

    def _field(self, name: str) -> Field:
        if name not in self.outer:
            raise KeyError(f"{self.item.name} has no field {name!r}; its fields are {', '.join(self.outer)}")
        return self.outer[name]

    def __getitem__(self, name: str) -> Any:
        array = self.view(name)
        return array if array.ndim or array.dtype.names else array.item()

    def value(self) -> Any:
        """A copy as dicts, lists and numbers; short arrays of char as str, long ones as bytes."""
        values = {name: _value(self.view(name), field, self.fields) for name, field in self.outer.items()}
        return values[""] if list(values) == [""] else values


def _value(array: np.ndarray[Any, Any], field: Field, fields: list[Field]) -> Any:
    if field.kind == STRUCT:
        if array.ndim:
            return [_value(array[i:i + 1].reshape(()), field, fields) for i in range(len(array))]
        return {name: _value(array[name], inner, fields) for name, inner in _inner(fields, field.name).items()}
    if field.kind == CHAR and field.count > 1:
        text = array.tobytes()
        return text.split(b"\0")[0].decode(errors="replace") if len(text) <= _TEXT_MAX else text
    return array.tolist()


class Frame(_Memory):
    """A value held by a reader: it cannot change until release(), or the end of `with`. time: of the write (the capture
    time of a picture is frame["time"]); sequence: number of the write; missed: writes since the previous frame."""

    def __init__(self, item: Item, frame: _CFrame) -> None:
        super().__init__(item, frame.data, False)
        self.time, self.sequence, self.missed = int(frame.time), int(frame.sequence), int(frame.missed)

    def release(self) -> None:
        if self.address:
            self.address = 0
            self.item._held = None
            _check(_release(self.item._open_handle()))

    def __enter__(self) -> Frame:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


class Loan(_Memory):
    """A frame to write in place; its content is an older frame's. Published at the end of `with`, or cancelled if that
    ends with an exception. Set `time` for another time than now."""
    time: int | None = None

    def __setitem__(self, name: str, value: Any) -> None:
        _assign(self.view(name), self._field(name), value, self.fields)

    def publish(self) -> None:
        self._end()
        moment = None if self.time is None else ctypes.byref(ctypes.c_int64(self.time))
        _check(_publish(self.item._open_handle(), moment))

    def cancel(self) -> None:
        self._end()
        _check(_cancel(self.item._open_handle()))

    def _end(self) -> None:
        self.address = 0
        self.item._held = None

    def __enter__(self) -> Loan:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if self.address:
            self.publish() if kind is None else self.cancel()


def _same_names(fields: dict[str, Field], value: Mapping[str, Any]) -> dict[str, Field]:
    if set(value) != set(fields):
        raise KeyError(f"the fields are {', '.join(fields)}; given were {', '.join(value)}")
    return fields


def _assign(array: np.ndarray[Any, Any], field: Field, value: Any, fields: list[Field]) -> None:
    """Assign a value that fits exactly: nothing is rounded, cut or wrapped."""
    if field.kind == STRUCT and array.ndim and not isinstance(value, np.ndarray):
        if len(value) != len(array):
            raise ValueError(f"{field.name}: {len(value)} elements for {len(array)}")
        for i, element in enumerate(value):
            _assign(array[i:i + 1].reshape(()), field, element, fields)
        return
    if field.kind == STRUCT and not isinstance(value, np.ndarray):
        for name, inner in _same_names(_inner(fields, field.name), value).items():
            _assign(array[name], inner, value[name], fields)
        return
    if field.kind == CHAR and isinstance(value, (str, bytes)):
        text = value.encode() if isinstance(value, str) else value
        if len(text) > array.size:
            raise ValueError(f"{field.name}: {len(text)} bytes do not fit into {array.size}")
        value = np.frombuffer(text.ljust(array.size, b"\0"), np.uint8)
    source = np.asarray(value)
    if source.size != array.size:
        raise ValueError(f"{field.name}: {source.size} elements for {array.size}")
    if array.dtype.kind in "iu" and array.size:
        limits = np.iinfo(array.dtype)
        if source.dtype.kind not in "iub":
            raise TypeError(f"{field.name}: takes whole numbers")
        if int(source.min()) < limits.min or int(source.max()) > limits.max:
            raise OverflowError(f"{field.name}: takes numbers from {limits.min} to {limits.max}")
    array[...] = source.reshape(array.shape)


class Item:
    """A handle on one item: it reads, or writes, or both."""

    def __init__(self, store: Store, name: str, handle: int) -> None:
        self.store, self.name, self._handle = store, name, handle
        self._held: _Memory | None = None
        self._opened = time_now()  # 0 after the first read()
        store._items.append(self)

    @property
    def type(self) -> str:
        return str(_type(self._open_handle()).decode())

    @property
    def fields(self) -> list[Field]:
        """All fields of the item's current layout, including nested ones."""
        found: list[Field] = []
        while at := _field(self._open_handle(), len(found)):
            c = at.contents
            found.append(Field(c.name.decode(), c.kind, c.bytes, c.count, c.offset, c.used, c.children))
        return found

    @property
    def missed(self) -> int:
        """Number of writes since this handle began to read that were not delivered to it."""
        return int(_missed(self._open_handle()))

    def keep(self, frames: int) -> None:
        """Keep that number of frames for IN_ORDER; after the first read it can only grow."""
        _check(_keep(self._open_handle(), frames))

    def acquire(self, timeout: float | None = None, tail: int = NEXT) -> Frame:
        """Hold a frame; without a timeout, wait without limit. One frame at a time."""
        frame = _CFrame()
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = _SLICE if end is None else max(0.0, min(_SLICE, end - time.monotonic()))
            result = _acquire(self._open_handle(), ctypes.byref(frame), left, tail)
            if result != -110 or (end is not None and time.monotonic() >= end):
                break
        _check(result)
        held = Frame(self, frame)
        self._held = held
        return held

    def frames(self, timeout: float | None = None, tail: int = NEXT) -> Iterator[Frame]:
        """Iterate over frames, each released when the next is requested; stops if none comes within the timeout."""
        while True:
            try:
                frame = self.acquire(timeout, tail)
            except TimeoutError:
                return
            with frame:
                yield frame

    def read(self, timeout: float | None = None, tail: int = CURRENT) -> Any:
        """A copy of a value: a dict, or a number. The first CURRENT value of another machine may be from before the
        subscription: a newer one is waited for, for a second (or the timeout), and if none comes, a warning has the age
        of the last one."""
        if tail == CURRENT and self._opened and b":" in _item_name(self._open_handle()):
            return self._read_first(timeout)
        with self.acquire(timeout, tail) as frame:
            return frame.value()

    def _read_first(self, timeout: float | None) -> Any:
        end = time.monotonic() + (_FIRST_WAIT if timeout is None else min(_FIRST_WAIT, timeout))
        with self.acquire(timeout, CURRENT) as frame:
            opened, self._opened = self._opened, 0
            if frame.time >= opened:
                return frame.value()
        try:
            with self.acquire(max(0.0, end - time.monotonic()), NEXT) as frame:
                return frame.value()
        except TimeoutError:
            pass
        with self.acquire(timeout, CURRENT) as frame:
            age = (time_now() - frame.time) / 1e9
            warnings.warn(f"{self.name}: no new value; the last one is {age:.3f} s old", stacklevel=3)
            return frame.value()

    def loan(self) -> Loan:
        """A free frame to write in place: with item.loan() as frame: frame["y"][:] = picture"""
        address = _P()
        _check(_loan(self._open_handle(), ctypes.byref(address)))
        assert address.value
        loan = Loan(self, address.value, True)
        self._held = loan
        return loan

    def write(self, value: Any, time: int | None = None) -> None:
        """Write a value: a dict of all fields, or a number for an item that is not a struct. time: default now; for
        values computed from a picture, that picture's frame["time"]."""
        with self.loan() as loan:
            loan.time = time
            values = {"": value} if list(loan.outer) == [""] else value
            for name in _same_names(loan.outer, values):
                loan[name] = values[name]

    def _open_handle(self) -> int:
        if not self._handle:
            raise ValueError(f"{self.name} is closed")
        return self._handle

    def close(self) -> None:
        """Close the handle and release the frame that it holds."""
        if self._handle:
            if self._held:
                self._held.address = 0
            _done(self._handle)
            self._handle = 0
            self.store._items.remove(self)

    def __enter__(self: AnyItem) -> AnyItem:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
