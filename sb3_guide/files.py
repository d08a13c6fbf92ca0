"""Files that are written whole or not at all, and that are checked before they are believed: text, JSON, YAML and arrays."""

import hashlib
import json
import os
import re
import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from inspect import signature
from math import inf
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import yaml
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

T = TypeVar("T")

MOST_JSON, MOST_YAML = 2**24, 2**18  # bytes; PyYAML takes seconds for the latter
MOST_VALUES = 100_000  # of a YAML file with its aliases written out


class Loader(yaml.SafeLoader):
    """PyYAML's, which also takes 1e-3 and 1e6 for numbers, as JSON and YAML 1.2 do."""


Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), [*"-+.0123456789"])


@contextmanager
def atomically(path: Path) -> Iterator[Path]:
    """
    Write a file beside the one that is meant, which takes its place when the block ends well, and is deleted if it doesn't.

    :param path: of the file that is meant; its folder exists
    :return: where to write; no other process is given the same place
    """
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, as UTF-8."""
    with atomically(path) as partial:
        partial.write_text(text, encoding="utf-8")


def read_text(path: Path, most: int) -> str:
    """
    :param path: of a file in UTF-8
    :param most: bytes that it may have
    :raises ValueError: if it has more, or is in another encoding
    """
    if (size := path.stat().st_size) > most:
        raise ValueError(f"{path} has {size} bytes: expected at most {most}")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no text in UTF-8 ({error})") from error


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file atomically."""
    write_text(path, json.dumps(content, indent=2) + "\n")


def read_json(path: Path, kind: type = dict) -> Any:
    """
    :param path: of a JSON file
    :param kind: of its content, such as dict
    :raises ValueError: if it is none, or of another kind
    """
    try:
        content = json.loads(read_text(path, MOST_JSON))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is no JSON: {error}") from error
    if not isinstance(content, kind):
        raise ValueError(f"{path} holds a {type(content).__name__}: expected a {kind.__name__}")
    return content


def filled(kind: type[T], what: str, content: Any) -> T:
    """
    :param kind: a dataclass
    :param what: is described, for errors
    :param content: of a file, or written by a caller: the fields by name
    :return: the record
    :raises ValueError: if it is no mapping, has other names, or lacks one
    """
    known = signature(kind).parameters
    if not isinstance(content, dict):
        raise ValueError(f"{what} is {reprlib.repr(content)}: expected a mapping with {', '.join(known)}")
    if unknown := [str(name) for name in content if name not in known]:
        raise ValueError(f"{what} has {', '.join(unknown)}: expected some of {', '.join(known)}")
    if missing := [name for name, field in known.items() if field.default is field.empty and name not in content]:
        raise ValueError(f"{what} lacks {', '.join(missing)}")
    return kind(**content)


def check_types(record: Any) -> None:
    """
    :param record: a dataclass whose content is from a file
    :raises TypeError: if a field is not of the type that its annotation says
    """
    for name, kind in get_type_hints(type(record)).items():
        if not fits(value := getattr(record, name), kind):
            raise TypeError(f"{name} is {reprlib.repr(value)}: expected {kind if get_origin(kind) else kind.__name__}")


def check_number(name: str, value: Any, least: float = 0, most: float = inf, whole: bool = False) -> None:
    """
    :param name: of the value, for the error
    :param value: of a file, or written by a caller
    :param least: that it may be
    :param most: that it may be
    :param whole: whether only an int will do
    :raises ValueError: if it is no number, or is out of range
    """
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool) and abs(value) < inf
    if not number or not least <= value <= most:
        expected = f"a {'whole ' if whole else ''}number from {least}" + ("" if most == inf else f" to {most}")
        raise ValueError(f"{name}={reprlib.repr(value)}: expected {expected}")


def fits(value: Any, kind: Any) -> bool:
    """:return: whether a value of JSON or YAML is of an annotated type"""
    origin, inside = get_origin(kind), get_args(kind)
    if origin is UnionType:
        return any(fits(value, each) for each in inside)
    if origin is list:
        return isinstance(value, list) and all(fits(each, inside[0]) for each in value)
    if origin is dict:
        return isinstance(value, dict) and all(fits(key, inside[0]) and fits(each, inside[1]) for key, each in value.items())
    return kind is Any or isinstance(value, kind)


def read_yaml(path: Path) -> Any:
    """
    :param path: of a YAML file
    :return: its content, in which there is nothing but plain values
    :raises ValueError: if it is none, or its aliases stand for more than can be meant
    """
    try:
        return parse_yaml(read_text(path, MOST_YAML))
    except ValueError as error:
        raise ValueError(f"{path} is no YAML: {error}") from error


def parse_yaml(text: str) -> Any:
    """
    :param text: YAML
    :return: its content, in which there is nothing but plain values
    :raises ValueError: see :func:`read_yaml`
    """
    try:
        loader = Loader(text)
        root = loader.get_single_node()
        if root is None:
            return None
        if written_out(root, {}) > MOST_VALUES:
            raise ValueError(f"it has more than {MOST_VALUES} values")
        return loader.construct_document(root)
    except Exception as error:  # PyYAML raises whatever the damaged place makes it raise
        raise ValueError(" ".join(str(error).split())) from error


def written_out(node: yaml.Node, counts: dict[int, int]) -> int:
    """
    :param node: of a YAML file
    :param counts: of the nodes that are counted already, by identity
    :return: values in it, every alias counting as much as what it stands for
    """
    if id(node) not in counts:
        counts[id(node)] = MOST_VALUES  # for an alias inside of what it stands for, which has no end
        children = node.value if isinstance(node, yaml.CollectionNode) else []
        pairs = (child if isinstance(child, tuple) else (child,) for child in children)
        counts[id(node)] = 1 + sum(written_out(each, counts) for pair in pairs for each in pair)
    return counts[id(node)]


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray], metadata: dict[str, str] | None = None) -> None:
    """
    Write a safetensors file atomically.

    :param path: of the file; its folder exists
    :param arrays: by name
    :param metadata: to be written along
    :raises OSError: if it can't be written
    """
    with atomically(path) as partial:
        partial.touch()
        mode = partial.stat().st_mode  # safetensors would let nobody but the owner read it
        try:
            save_file({name: np.asarray(array, order="C") for name, array in arrays.items()}, partial, metadata)
            partial.chmod(mode)
        except SafetensorError as error:
            raise OSError(f"{path} can't be written: {error}") from error


def read_arrays(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """
    Read a safetensors file, which can't execute code. It takes as much memory as the file is long, whatever it claims.

    :param path: of the file
    :return: arrays by name, and metadata
    :raises ValueError: if it is damaged
    """
    try:
        with safe_open(path, framework="numpy") as file:
            return {name: file.get_tensor(name) for name in file.keys()}, file.metadata() or {}  # noqa: SIM118  # no mapping
    except (SafetensorError, AttributeError, LookupError, TypeError, ValueError) as error:  # as numpy lacks some types
        raise ValueError(f"{path} is damaged ({error})") from error


def checksum(arrays: Mapping[str, np.ndarray], description: Any = None) -> str:
    """
    :param arrays: by name
    :param description: of them, as JSON
    :return: SHA-256 over the description if there is one, and names, types, shapes and contents of all arrays
    """
    digest = hashlib.sha256()
    if description is not None:
        digest.update(json.dumps(description, sort_keys=True).encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.asarray(array, order="C").data)
    return digest.hexdigest()
