"""How kernels come to be and what happens where they cannot: no compiler, a wrong kernel."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import sys
import sysconfig
import time
import types
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.vehicle import PAPER, UPSTREAM_2024, Batch
from dart_hal.vehicle.native import build, check, committed, kernel, library, model, status
from dart_hal.vehicle.native.build import CannotCompile, Variant, compiler
from dart_hal.vehicle.native.emit import body, source
from dart_hal.vehicle.native.model import form_of, trace
from tests.common import ROOT

KINEMATIC = replace(PAPER, kind="kinematic")
F64 = Variant(64, False)
needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@pytest.fixture
def nothing_built(monkeypatch, tmp_path):
    """A machine on which no kernel was ever compiled."""
    monkeypatch.setattr(build, "BUILT", tmp_path / "built")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv(library.NATIVE_SWITCH, raising=False)
    kernel.find_kernel.cache_clear()
    yield tmp_path
    kernel.find_kernel.cache_clear()


def test_the_committed_kernels_are_those_of_the_equations():
    """`make native` would change nothing."""
    assert build.COMMITTED.read_text(encoding="utf-8") == committed.text()


@pytest.mark.parametrize("p", committed.FORMS, ids=lambda p: f"{p.name}-{p.kind}")
def test_shipped_sets_find_their_committed_text(p):
    for kind in committed.KINDS:
        assert body(trace(form_of(p), kind)) in committed.text()


def test_vector_conditions_of_the_text():
    """No cosine (gcc fuses it with the sine) and no branch or array in the loops over cars.

    COS is a shifted sine, except in an exact kernel.
    """
    loops = re.findall(r"#pragma omp simd\n(.*?)\n    }\n}", committed.text(), re.S)
    assert len(loops) == 2 * len(committed.FORMS) * len(committed.KINDS)
    for loop in loops:
        assert not re.search(r"cos\b|\bif\b|\?|while|real \w+\[", loop)
    assert "COS(x) F(sin)" in committed.text()
    assert "F(sin)" in loops[-1], "the control: what is looked for is there to be found"


# where there is no compiler, or a bad one

@pytest.mark.parametrize("command", ["no-such-compiler", "false"])
def test_without_a_compiler_numpy_takes_over_and_reports_it(nothing_built, monkeypatch, command):
    monkeypatch.setenv("CC", command)
    batch = Batch(PAPER, 3)
    assert batch.engine == "numpy"
    batch.advance(np.full(3, 0.3, dtype=np.float32), np.zeros(3, dtype=np.float32))
    assert batch.state[3].min() > 0
    assert status().startswith("numpy; no compiled kernels")
    assert command in status()
    with pytest.raises(UsageError) as refused:
        Batch(PAPER, 3, engine="native")
    assert command in str(refused.value)
    assert list(nothing_built.rglob("*.so")) == []


def test_switched_off_by_the_user(monkeypatch):
    monkeypatch.setenv(library.NATIVE_SWITCH, "0")
    assert Batch(PAPER, 3).engine == "numpy"
    assert f"{library.NATIVE_SWITCH}=0" in status()


@pytest.mark.slow
@needs_compiler
def test_compiled_on_demand_once(nothing_built, monkeypatch):
    first = kernel.CompiledStep(KINEMATIC, "motion", 0.01)
    assert first.origin == "compiled on demand"
    made = list(nothing_built.rglob("*.so"))
    assert len(made) == 1
    kernel.find_kernel.cache_clear()
    monkeypatch.setenv("CC", "no-such-compiler")    # gone, the library stays
    assert kernel.CompiledStep(KINEMATIC, "motion", 0.01).origin == "compiled on demand"
    with pytest.raises(CannotCompile, match="no C compiler"):
        kernel.CompiledStep(KINEMATIC, "motion", 0.01, np.float32)


@pytest.mark.slow
@needs_compiler
def test_another_processor_does_not_get_this_one_s_library(nothing_built, monkeypatch):
    kernel.CompiledStep(KINEMATIC, "motion", 0.01)
    kernel.find_kernel.cache_clear()
    monkeypatch.setattr(build, "processor", lambda: "another one")
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(CannotCompile, match="no C compiler"):
        kernel.CompiledStep(KINEMATIC, "motion", 0.01)


@needs_compiler
def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CannotCompile, match="cannot write"):
        build.compile_kernel("", F64, tmp_path / "file" / "cache")


@needs_compiler
def test_the_output_of_the_compiler_is_passed_on(tmp_path):
    with pytest.raises(CannotCompile, match=r"failed: .*error"):
        build.compile_kernel("this is no C\n", F64, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@needs_compiler
def test_a_compiler_without_vectors_still_compiles(nothing_built, monkeypatch):
    """An older processor, another C library: fewer flags, the same numbers."""
    plain = nothing_built / "plain-cc"
    real = " ".join(compiler())
    plain.write_text(f"""#!/bin/sh
for a in "$@"; do case "$a" in -m*|-lmvec) echo "unknown $a" >&2; exit 1;; esac; done
exec {real} "$@"
""", encoding="utf-8")
    plain.chmod(0o755)
    monkeypatch.setenv("CC", str(plain))
    assert kernel.CompiledStep(KINEMATIC, "motion", 0.01).origin == "compiled on demand"


@pytest.mark.slow
@needs_compiler
def test_a_damaged_library_of_the_package_is_replaced_by_one_on_demand(nothing_built, monkeypatch):
    text = build.COMMITTED.read_text(encoding="utf-8")
    broken = build.BUILT / f"{build.key(text, F64)}.so"
    broken.parent.mkdir(parents=True, exist_ok=True)
    broken.write_bytes(b"not a library")
    assert kernel.CompiledStep(KINEMATIC, "motion", 0.01).origin == "compiled on demand"


@pytest.mark.slow
@needs_compiler
def test_a_damaged_library_is_compiled_again(nothing_built):
    text = source([body(trace(form_of(KINEMATIC), "motion"))])
    broken = build.cache_folder() / f"{build.key(text, F64)}.so"
    broken.parent.mkdir(parents=True)
    broken.write_bytes(b"not a library")
    assert kernel.CompiledStep(KINEMATIC, "motion", 0.01).origin == "compiled on demand"
    assert broken.stat().st_size > 1000


def test_a_damaged_library_without_a_compiler_is_no_kernel(nothing_built, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    text = source([body(trace(form_of(KINEMATIC), "motion"))])
    broken = build.cache_folder() / f"{build.key(text, F64)}.so"
    broken.parent.mkdir(parents=True)
    broken.write_bytes(b"not a library")
    with pytest.raises(CannotCompile, match="no C compiler"):
        kernel.CompiledStep(KINEMATIC, "motion", 0.01)
    assert Batch(KINEMATIC, 3).engine in ("native", "numpy")


# a kernel of other equations

@needs_compiler
def test_changed_equations_get_a_kernel_of_their_own(nothing_built, monkeypatch):
    """Regenerating cannot be forgotten: the committed text no longer fits and is not used."""
    def heavier(p, xp, dt, method):
        step = model.make_car_step(p, xp, dt, method)

        def change_step(*values):
            out = step(*values)
            return (*out[:3], 0.5 * out[3], *out[4:])

        return change_step

    monkeypatch.setitem(model.STEP_FACTORIES, "car", heavier)
    trace.cache_clear()
    try:
        assert body(trace(form_of(KINEMATIC), "car")) not in library._read_committed()
        found = kernel.find_kernel(form_of(KINEMATIC), "car", "rk4", 64, False)
        assert found.origin == "compiled on demand"
    finally:
        trace.cache_clear()


def wrong(text: str, site: int) -> str:
    """The text with its site-th plus or minus of the step turned round."""
    head, step = text.split("step_", 1)
    at = [m.start() for m in re.finditer(r" [+-] ", step[:step.index("}\n}")])][site]
    turned = {"+": "-", "-": "+"}[step[at + 1]]
    return f"{head}step_{step[:at + 1]}{turned}{step[at + 2:]}"


@needs_compiler
@pytest.mark.parametrize("site", range(0, 49, 7))
@pytest.mark.slow
def test_one_turned_sign_in_a_kernel_is_noticed(tmp_path, site):
    """The negative control of the check before first use: mutants are refused, the original not."""
    form = form_of(KINEMATIC)
    traced = trace(form, "motion")
    texts = body(traced), wrong(body(traced), site)
    assert texts[0] != texts[1]
    runs = [library._load_function(build.compile_kernel(source([t]), F64, tmp_path), traced.name)
            for t in texts]
    check.check(runs[0], traced, F64, form, "motion", "rk4")
    with pytest.raises(CannotCompile, match="differs from the Python equations"):
        check.check(runs[1], traced, F64, form, "motion", "rk4")


@pytest.mark.slow
@needs_compiler
def test_an_exact_kernel_that_rounds_differently_is_noticed(tmp_path):
    """The control: the same text with -ffast-math."""
    form = form_of(UPSTREAM_2024)
    traced = trace(form, "tick")
    text = source([body(traced)])
    exact = Variant(64, False, exact=True)
    runs = [library._load_function(build.compile_kernel(text, v, tmp_path), traced.name)
            for v in (exact, F64)]
    check.check(runs[0], traced, exact, form, "tick", "rk4")
    with pytest.raises(CannotCompile, match="differs from the Python equations"):
        check.check(runs[1], traced, exact, form, "tick", "rk4")


@pytest.mark.slow
@needs_compiler
def test_a_wrong_kernel_is_not_used(nothing_built, monkeypatch):
    traced = trace(form_of(KINEMATIC), "car")
    path = build.compile_kernel(source([wrong(body(traced), 9)]), Variant(32, False),
                                nothing_built)
    monkeypatch.setattr(kernel, "load",
                        lambda *_: (library._load_function(path, traced.name), "bad"))
    assert Batch(KINEMATIC, 3).engine == "numpy"
    with pytest.raises(UsageError, match="no compiled kernel"):
        Batch(KINEMATIC, 3, engine="native")


@pytest.mark.slow
@needs_compiler
@pytest.mark.skipif(platform.machine() != "x86_64" or platform.libc_ver()[0] != "glibc"
                    or tuple(map(int, platform.libc_ver()[1].split("."))) < (2, 35),
                    reason="vector tanh needs glibc 2.35 on x86-64")
def test_the_functions_are_those_for_whole_vectors(tmp_path):
    text = source([body(trace(form_of(UPSTREAM_2024), "motion"))])
    made = build.compile_kernel(text, F64, tmp_path).read_bytes()
    for name in (b"sin", b"atan", b"exp", b"tanh"):
        assert re.search(rb"_ZGV[bcde]N\d+v_" + name, made), name


# the build of the package

@pytest.fixture
def hook(monkeypatch, tmp_path):
    """``hatch_build.KernelHook`` over a substitute for hatchling, with its messages."""
    interface = types.ModuleType("hatchling.builders.hooks.plugin.interface")
    interface.BuildHookInterface = object
    metadata = types.ModuleType("hatchling.metadata.plugin.interface")
    metadata.MetadataHookInterface = object
    for name in ("hatchling", "hatchling.builders", "hatchling.builders.hooks",
                 "hatchling.builders.hooks.plugin", "hatchling.metadata",
                 "hatchling.metadata.plugin"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    for module in (interface, metadata):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    spec = importlib.util.spec_from_file_location("hatch_build_test", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    native = tmp_path / module.NATIVE
    native.mkdir(parents=True)
    (native / "build.py").write_text((build.HERE / "build.py").read_text(encoding="utf-8"),
                                     encoding="utf-8")
    (native / "kernel.c").write_text("int nothing;\n", encoding="utf-8")
    made = module.KernelHook()
    messages = []
    made.root = str(tmp_path)
    made.target_name = "wheel"
    made.app = types.SimpleNamespace(display_info=messages.append, display_warning=messages.append)
    return made, messages, native / "_built"


@needs_compiler
@pytest.mark.parametrize(("version", "pure"), [("standard", False), ("editable", True)])
@pytest.mark.slow_except("editable-True")
def test_building_the_package_compiles_all_variants(hook, version, pure):
    made, messages, folder = hook
    folder.mkdir()
    (folder / "kernel-f64-of-yesterday.so").write_bytes(b"")
    data = {"artifacts": [], "pure_python": True}
    made.initialize(version, data)
    assert len(list(folder.glob("*.so"))) == len(build.VARIANTS)
    assert data["pure_python"] is pure
    assert bool(data["artifacts"]) is not pure
    assert "4 libraries" in messages[0]
    tag = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"
    assert data.get("tag") == (None if pure else tag)


@pytest.mark.slow
@needs_compiler
def test_portable_libraries_are_used_where_nothing_can_be_compiled(nothing_built, monkeypatch):
    build.build_committed(build.BUILT, portable=True)
    monkeypatch.setenv("CC", "no-such-compiler")
    assert kernel.CompiledStep(KINEMATIC, "motion", 0.01).origin == "built for any processor"


def test_building_without_a_compiler_succeeds_and_reports_it(hook, monkeypatch):
    made, messages, folder = hook
    monkeypatch.setenv("CC", "no-such-compiler")
    data = {"artifacts": [], "pure_python": True}
    made.initialize("standard", data)
    assert data == {"artifacts": [], "pure_python": True}
    assert "numpy takes over: no C compiler (no-such-compiler)" in messages[0]
    assert not folder.exists()


def test_a_source_archive_holds_no_library(hook):
    made, messages, folder = hook
    made.target_name = "sdist"
    made.initialize("standard", {})
    assert messages == []
    assert not folder.exists()


@needs_compiler
def test_a_library_in_use_is_the_last_to_be_forgotten(tmp_path, monkeypatch):
    monkeypatch.setattr(build, "MAX_CACHED_LIBRARIES", 2)
    monkeypatch.setattr(build, "_build", lambda command, text, variant, scratch, machines:
                        (scratch / "kernel.so").write_text(text) and scratch / "kernel.so")
    used = "int a;"
    idle = "int b;"
    new = "int c;"
    for age, text in ((200, used), (100, idle)):
        path = build.compile_kernel(text, F64, tmp_path)
        os.utime(path, (time.time() - age,) * 2)
    build.compile_kernel(used, F64, tmp_path)
    build.compile_kernel(new, F64, tmp_path)
    assert sorted(p.read_text() for p in tmp_path.glob("*.so")) == [used, new]
