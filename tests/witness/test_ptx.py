"""NVIDIA's own assembler translates the PTX of every kernel that the commands compute; no GPU is needed for that."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import twin
from made.lanes import CONTRASTING
from twin.analysis.error_propagation import Spread
from twin.analysis.tolerance import tolerance
from twin.analysis.workspace import workspace
from twin.api.equation_checks import validate_samples
from twin.codegen import Kernel
from twin.codegen.gpu_entry import THREADS
from twin.core import assets
from twin.core.machine_code import PTX_ARCHITECTURE, ptx
from twin.formula import evaluator

pytestmark = pytest.mark.witness

ARCHITECTURES = (PTX_ARCHITECTURE, "sm_90")
"""The oldest one that is meant, and, for the robots that differ most, that of the cards of the prototype."""

REGISTERS = 255
"""What a thread can have at most; with THREADS in a block, every card has as many."""


@pytest.fixture
def assembler(foreign) -> Path:
    folder = foreign.need("ptxas").folder
    (found,) = folder.glob("lib/python*/site-packages/nvidia/cuda_nvcc/bin/ptxas")
    return found


def kernels(name: str, monkeypatch) -> dict[str, Kernel]:
    """Return {text for a GPU: kernel} of what a workspace, a tolerance and batches of poses compute."""
    made: list[Kernel] = []
    begin = Kernel.__init__

    def noted(self, *arguments, **more):
        begin(self, *arguments, **more)
        made.append(self)

    monkeypatch.setattr(Kernel, "__init__", noted)
    monkeypatch.setattr(evaluator, "_KERNEL_SAMPLES", 1)
    robot = twin.load(name)
    workspace(robot, 2000)
    validate_samples(robot, 1000)
    tolerance(robot, Spread(1e-5, 1e-5, 1e-6, 1e-5), samples=1000)
    q = np.repeat(robot.loops.q[None], 20, axis=0)
    Ts = robot.loops.forward_many(q).Ts_base_tool
    kin = robot.kinematics()
    if kin.closed_inverse:
        kin.inverse_many(Ts)
    if kin.closed_forward:
        kin.forward_many(q)
    monkeypatch.undo()
    return {kernel.for_gpu.text: kernel for kernel in made if kernel.for_gpu is not None}


@pytest.mark.parametrize("name", assets.names())
def test_every_kernel_is_assembled(name, assembler, tmp_path, monkeypatch):
    texts = kernels(name, monkeypatch)
    assert len(texts) >= 3, name
    for text in texts:
        code = ptx(text)
        assert ".extern" not in code
        assert f".maxntid {THREADS}" in code
        assert re.search(r"\b(?:ld|st)\.global\.b64", code)
        assert not re.search(r"\.(?:f32|approx)\b", code), "less than double precision"
        # Without a named rounding, the assembler may fuse operations, and results would not be the processor's.
        assert not re.search(r"\b(?:add|sub|mul|fma|div|rcp|sqrt)\.f64\b", code)
        source = tmp_path / "kernel.ptx"
        source.write_text(code)
        chosen = ARCHITECTURES if name in CONTRASTING else (PTX_ARCHITECTURE,)
        for architecture in chosen:
            command = [assembler, "--verbose", f"-arch={architecture}", source, "-o", tmp_path / "kernel.cubin"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            (registers,) = re.findall(r"Used (\d+) registers", done.stderr)
            assert int(registers) <= REGISTERS
            assert (tmp_path / "kernel.cubin").stat().st_size > 1000


def test_the_assembler_refuses_what_is_no_ptx(assembler, tmp_path, monkeypatch):
    text = next(iter(kernels("pa10", monkeypatch)))
    source = tmp_path / "kernel.ptx"
    source.write_text(ptx(text).replace("fma.rn.f64", "fma.rn.f65", 1))
    command = [assembler, f"-arch={PTX_ARCHITECTURE}", source, "-o", tmp_path / "kernel.cubin"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "f65" in done.stderr
