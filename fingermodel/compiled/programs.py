"""Compiled programs that start quickly: what tracing them made is kept beside what the compiler made.

JAX keeps compiled code on disk (`jax_compilation_cache_dir`), but only finds it after a program has been traced and
lowered, which takes seconds for the whole catalogue. `stored` keeps the lowered program too, under a key of everything
that it follows from: this package's sources, the structure, the shapes, and the versions of JAX. Of several processes
that start at once, one makes a program, and the others wait for it.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, nullcontext
from functools import cache, partial, update_wrapper
from pathlib import Path
from typing import Any, Generic, TypeVar

import jax
import jax.export
import jaxlib.version
import numpy as np
from filelock import FileLock

from daq.files import replacing

_known: set[type] = set()
# What takes long to compile and runs for milliseconds: on a machine that has not compiled it yet, that is most of a
# first diagnosis. By these it is compiled in two thirds of the time, and runs as fast (see benchmarks/compiling.md).
HURRIED: dict[str, str | bool | int] = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}
# What runs a few times only; each operation is rounded by itself, as where none is compiled.
UNOPTIMISED: dict[str, str | bool] = {"xla_backend_optimization_level": "0"}

# Longest that a process waits for another's program: that one may have been suspended.
WAIT_S = 120.0

Result = TypeVar("Result")


class Stored(Generic[Result]):
    """A compiled function of (structure, *arrays), its first argument static.

    Args:
        function: to compile.
        returned: named tuples in its result.
        options: of the compiler.
    """

    def __init__(
        self, function: Callable[..., Result], returned: tuple[type, ...], options: dict[str, str | bool | int]
    ) -> None:
        update_wrapper(self, function)
        self._name, self.jitted, self._returned = function.__name__, jax.jit(function, static_argnums=0), returned
        self.options = options
        self._programs: dict[Any, Callable[..., Result]] = {}

    def __call__(self, structure: Any, *arguments: Any) -> Result:
        """Call what was compiled for such arguments; traced as part of another program where they are traced."""
        return self.program(structure, *arguments)(*arguments)

    def program(self, structure: Any, *arguments: Any) -> Callable[..., Result]:
        """What answers for these arguments, and any others of their shapes, given without the structure.

        To find it takes a good part of a short call: who calls often asks once. A new one is compiled in a thread of
        its own, so that the next one can be traced meanwhile.
        """
        leaves, tree = jax.tree.flatten(arguments)
        if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            return partial(self.jitted, structure)
        key = (structure, tree, tuple(map(_shape, leaves)))
        program = self._programs.get(key)
        if program is None:
            with ExitStack() as held:
                exported = _exported(self._name, self.jitted, structure, arguments, self._returned, held)
                jitted = jax.jit(exported, compiler_options=self.options)
                program = self._programs[key] = _compiled(jitted, arguments, held.pop_all())
        return program


def stored(*returned: type, hurried: bool = False) -> Callable[[Callable[..., Result]], Stored[Result]]:
    """Compile a function of (structure, *arrays), its first argument static, and keep what tracing it made.

    Args:
        returned: named tuples in the function's result.
        hurried: whether it takes so long to compile that less is to be made of it.
    """
    return lambda function: Stored(function, returned, HURRIED if hurried else {})


def _compiled(
    jitted: Callable[..., Result], arguments: tuple[Any, ...], held: AbstractContextManager[object]
) -> Callable[..., Result]:
    """Begin to compile, and let go of what is held once that is done; whoever calls the answer waits until then."""

    def compile_it() -> None:
        with held:
            jitted(*arguments)

    compiling = _compilers().submit(compile_it)

    def program(*given: Any) -> Result:
        compiling.result()
        return jitted(*given)

    return program


@cache
def _compilers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(2, "compiler")


def _exported(
    name: str, jitted: Any, structure: Any, arguments: tuple[Any, ...], returned: tuple[type, ...], held: ExitStack
) -> Callable[..., Any]:
    file = _file(name, structure, arguments)
    if file is None:
        return partial(jitted, structure)
    for kind in (*returned, *_kinds(arguments)):
        _know(kind)
    exported = _read(file)
    if exported is None:
        held.enter_context(_alone(file))
        exported = _read(file)
    if exported is None:
        exported = jax.export.export(_bound(jitted, structure))(*arguments)
        # Once it is compiled: whoever finds the file finds what the compiler made of it, too.
        held.callback(_write, file, bytes(exported.serialize()))
    return exported.call


def _alone(file: Path) -> AbstractContextManager[object]:
    """Let no other process make the same program meanwhile; where files cannot be locked, each makes its own."""
    lock = file.parents[1] / "locks" / file.name
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        # Compiling is done in another thread, which lets go.
        return FileLock(lock, thread_local=False, fallback_to_soft=False).acquire(WAIT_S)
    except (OSError, NotImplementedError):
        return nullcontext()


def _bound(jitted: Any, structure: Any) -> Any:
    return jax.jit(lambda *arrays: jitted(structure, *arrays))


def _file(name: str, structure: Any, arguments: tuple[Any, ...]) -> Path | None:
    """Where a program is kept; None where there is no place, or something in it is not known by its text."""
    settings: dict[str, Any] = jax.config.values
    folder, text = settings["jax_compilation_cache_dir"], repr(structure)
    effects = getattr(structure, "effects", ())
    if not folder or " at 0x" in text or not all(map(is_ours, effects)):
        return None
    leaves, tree = jax.tree.flatten(arguments)
    versions = (jax.__version__, jaxlib.version.__version__, jax.default_backend(), settings["jax_enable_x64"])
    said = repr((name, text, str(tree), _shapes(leaves), versions, _sources()))
    return Path(folder) / "traced" / f"{name.strip('_')}-{hashlib.sha256(said.encode()).hexdigest()}"


def is_ours(effect: object) -> bool:
    """Whether an effect's code is this package's, not a user's, which may change; a formula's is."""
    return type(effect).__module__.startswith("fingermodel.")


def _shape(leaf: Any) -> tuple[Any, Any]:
    """Shape and type of a leaf: asked for at every call, so without making text of it."""
    try:
        return leaf.shape, leaf.dtype
    except AttributeError:
        return np.shape(leaf), np.result_type(leaf)


def _shapes(leaves: Sequence[Any]) -> tuple[tuple[tuple[int, ...], str], ...]:
    """The same of all, as text that can be kept."""
    return tuple((shape, str(kind)) for shape, kind in map(_shape, leaves))


@cache
def _sources() -> str:
    """Fingerprint of this package."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _read(file: Path) -> Any:
    try:
        return jax.export.deserialize(bytearray(file.read_bytes()))
    except FileNotFoundError:
        return None
    except Exception:
        return None  # a damaged or foreign file is nothing but a program to be traced anew


def _write(file: Path, content: bytes) -> None:
    """Write whole or not at all; a program that cannot be kept still runs."""
    with contextlib.suppress(OSError), replacing(file) as temporary:
        temporary.write_bytes(content)


def _kinds(tree: Any) -> Iterator[type]:
    """Every named tuple's type within a tree of tuples."""
    if isinstance(tree, tuple):
        if hasattr(tree, "_fields"):
            yield type(tree)
        for one in tree:
            yield from _kinds(one)


def _know(kind: Any) -> None:
    """Tell JAX how to write a named tuple's type down."""
    if kind not in _known:
        _known.add(kind)
        jax.export.register_namedtuple_serialization(kind, serialized_name=f"{kind.__module__}.{kind.__name__}")
