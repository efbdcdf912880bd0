"""What the doctor reads of the machine with the help of other programs."""

from __future__ import annotations

import asyncio
import sys

_TORCH = "import torch; print(torch.cuda.get_device_name(0) if torch.cuda.is_available() else '')"


async def run_briefly(*command: str, limit_s: float) -> str | None:
    """Return what a program prints, None when it is missing, fails or takes too long."""
    try:
        process = await asyncio.create_subprocess_exec(
            *command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
        )
    except OSError:
        return None
    try:
        output, _ = await asyncio.wait_for(process.communicate(), limit_s)
    except TimeoutError:
        return None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return output.decode(errors="replace").strip() if process.returncode == 0 else None


async def read_time_server() -> bool | None:
    """Return whether a time server sets the clock, None when that cannot be read."""
    answer = await run_briefly(
        "timedatectl", "show", "--property=NTPSynchronized", "--value", limit_s=3.0
    )
    return {"yes": True, "no": False}.get(answer or "")


async def read_gpu_driver() -> str | None:
    """Return the first GPU as its driver names it, None without one."""
    query = "--query-gpu=name,memory.total,driver_version"
    answer = await run_briefly("nvidia-smi", query, "--format=csv,noheader", limit_s=10.0)
    return answer.splitlines()[0] if answer else None


async def read_torch_device(limit_s: float) -> str | None:
    """Return the GPU torch would use, empty for none; torch is loaded in a child process alone."""
    return await run_briefly(sys.executable, "-P", "-c", _TORCH, limit_s=limit_s)
