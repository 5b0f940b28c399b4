"""Run a command behind a filter of system calls, as a container runtime does with the same profile.

    python tests/seccomp.py PROFILE.json COMMAND...

Knows the part of the OCI profile format that a profile without conditions needs. The filter is built and
put in force by libseccomp, the library that the runtimes themselves use.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import json
import os
import sys
from pathlib import Path
from typing import Any

_ALLOW = 0x7FFF0000
_ERRNO = 0x00050000
_COMPARE = {
    "SCMP_CMP_NE": 1,
    "SCMP_CMP_LT": 2,
    "SCMP_CMP_LE": 3,
    "SCMP_CMP_EQ": 4,
    "SCMP_CMP_GE": 5,
    "SCMP_CMP_GT": 6,
    "SCMP_CMP_MASKED_EQ": 7,
}


class _Comparison(ctypes.Structure):
    _fields_ = (
        ("index", ctypes.c_uint),
        ("op", ctypes.c_int),
        ("value", ctypes.c_uint64),
        ("value_two", ctypes.c_uint64),
    )


def library() -> ctypes.CDLL | None:
    """libseccomp, or ``None`` where it is not installed."""
    name = ctypes.util.find_library("seccomp")
    if name is None:
        return None
    found = ctypes.CDLL(name, use_errno=True)
    found.seccomp_init.restype = ctypes.c_void_p
    found.seccomp_init.argtypes = (ctypes.c_uint32,)
    found.seccomp_load.argtypes = (ctypes.c_void_p,)
    found.seccomp_syscall_resolve_name.argtypes = (ctypes.c_char_p,)
    found.seccomp_rule_add_array.argtypes = (
        ctypes.c_void_p,
        ctypes.c_uint32,
        ctypes.c_int,
        ctypes.c_uint,
        ctypes.c_void_p,
    )
    return found


def confine(seccomp: ctypes.CDLL, profile: dict[str, Any]) -> None:
    """Put the profile in force for this process and all that it starts. There is no way back."""
    default = _action(profile["defaultAction"], profile.get("defaultErrnoRet", 1))
    context = seccomp.seccomp_init(default)
    for rule in profile["syscalls"]:
        action = _action(rule["action"], rule.get("errnoRet", 1))
        arguments = [
            _Comparison(one["index"], _COMPARE[one["op"]], one["value"], one.get("valueTwo", 0))
            for one in rule.get("args", ())
        ]
        for name in rule["names"]:
            number = seccomp.seccomp_syscall_resolve_name(name.encode())
            if number == -1 or action == default:  # as the runtimes do
                continue
            array = (_Comparison * len(arguments))(*arguments)
            done = seccomp.seccomp_rule_add_array(context, action, number, len(arguments), array)
            assert done == 0, f"{name}: {os.strerror(-done)}"
    done = seccomp.seccomp_load(context)
    assert done == 0, os.strerror(-done)


def _action(name: str, error: int) -> int:
    return {"SCMP_ACT_ALLOW": _ALLOW, "SCMP_ACT_ERRNO": _ERRNO | error}[name]


def main(profile: str, *command: str) -> None:
    """Become the command."""
    seccomp = library()
    assert seccomp is not None, "no libseccomp"
    confine(seccomp, json.loads(Path(profile).read_text()))
    os.execvp(command[0], command)


if __name__ == "__main__":
    main(*sys.argv[1:])
