"""Nothing is begun that would not fit into this machine, or would not end: refused before it is allocated."""

import os
import resource
import subprocess
import sys

import pytest

from specklegen.core import memory
from specklegen.core.budgets import MOST_SECONDS, require_time
from specklegen.core.errors import RuleError
from specklegen.core.memory import available_memory, memory_limit, require_memory

GIB = 2**30


def test_what_does_not_fit_is_refused(monkeypatch):
    most = 16 * GIB
    monkeypatch.setattr(memory, "available_memory", lambda: most)
    require_memory("Owner", "held", 0.5 * most, "a thing", "Ask for less.")
    with pytest.raises(RuleError, match=r"Owner must be held within .* GiB; got '.* GiB for a thing'. Ask for less."):
        require_memory("Owner", "held", 0.51 * most, "a thing", "Ask for less.")
    with pytest.raises(RuleError, match=r"got 'nan GiB for a thing'|got '.*e\+\d+ GiB for a thing'"):
        require_memory("Owner", "held", 1e40, "a thing", "Ask for less.")
    require_memory("Owner", "held", 0.8 * most, "a thing", "Ask for less.", share=0.9)


def test_a_control_group_bounds_memory(tmp_path):
    """Of version 2 every group above counts, of version 1 the controller of memory; "max" is no limit."""
    groups, root = tmp_path / "cgroup", tmp_path / "fs"
    for folder, name, said in (
        ("a", "memory.max", str(4 * GIB)), ("a/b", "memory.max", "max"),
        ("memory/a", "memory.limit_in_bytes", str(3 * GIB)), ("cpu/a", "memory.limit_in_bytes", "1"),
    ):  # fmt: skip
        (root / folder).mkdir(parents=True, exist_ok=True)
        (root / folder / name).write_text(said)
    groups.write_text("0::/a/b\n")
    assert memory._cgroup_limits(root, groups) == [4 * GIB]
    groups.write_text("5:cpu:/a\n4:memory,devices:/a/gone\n")
    assert memory._cgroup_limits(root, groups) == [3 * GIB]
    assert memory._cgroup_limits(root, tmp_path / "none") == []


def test_a_job_of_slurm_bounds_memory(monkeypatch):
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "1024")
    assert memory_limit.__wrapped__() == GIB
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "0")  # all of it
    assert memory_limit.__wrapped__() > GIB
    monkeypatch.setenv("SLURM_MEM_PER_CPU", "512")
    monkeypatch.setenv("SLURM_CPUS_ON_NODE", "4")
    assert memory_limit.__wrapped__() == 2 * GIB


def test_ulimit_bounds_memory():
    """Less what the process holds already; in a process of its own, since a limit cannot be raised again."""
    script = "from specklegen.core.memory import available_memory; print(available_memory())"
    limit = 6 * GIB
    said = subprocess.run([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, check=True,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))  # fmt: skip
    assert 0 < int(said.stdout) < limit


def test_what_is_free_bounds_memory(monkeypatch):
    monkeypatch.setattr(memory, "_bounds_now", lambda: [GIB])
    assert available_memory() == GIB
    monkeypatch.setattr(memory, "_bounds_now", list)
    assert available_memory() == memory_limit() <= os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def test_what_does_not_end_is_refused():
    require_time("Owner", MOST_SECONDS, "a thing", "Ask for less.")
    with pytest.raises(RuleError, match="Owner must be done within 30 days; got '60 days for a thing'. Ask for less."):
        require_time("Owner", 2 * MOST_SECONDS, "a thing", "Ask for less.")
    with pytest.raises(RuleError):
        require_time("Owner", float("nan"), "a thing", "Ask for less.")
