"""Serves a process build over gRPC: for each stream a process of its own, whose messages are passed on."""

from __future__ import annotations

import errno
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from resim.core.errors import FunctionError, InputError
from resim.function import framed, packed
from resim.simulation.function.grpc_wire import METHOD, OPTIONS, decode, encode, grpc_library, host_of
from resim.simulation.function.program import FunctionProgram

STREAMS = 256
"""Runs that are served at once; more are refused."""
_KEPT_ALIVE = (("grpc.keepalive_time_ms", 60_000), ("grpc.keepalive_permit_without_calls", 1))
"""Who is gone without a word is found out."""
_END_GROUPS = """
import os, sys
groups = set()
for line in sys.stdin:
    groups ^= {int(line)}
for group in groups:
    try:
        os.killpg(group, 9)
    except OSError:
        pass
"""
"""Program that ends the process groups it was told an odd number of times, once nobody can tell it more."""
_THIS_MACHINE = "Give one of this machine, such as 127.0.0.1, or 0.0.0.0 for all that it has."
_REASONS: dict[int | None, tuple[str, str]] = {
    errno.EADDRINUSE: (
        "another program listens there", "End it, or give another port; port 0 takes any that is free.",
    ),
    errno.EADDRNOTAVAIL: ("it is no address of this machine", _THIS_MACHINE),
    **dict.fromkeys((socket.EAI_NONAME, socket.EAI_AGAIN), ("there is no such host", _THIS_MACHINE)),
    errno.EACCES: ("you may not use that port", "Give one above 1023."),
}  # fmt: skip
"""Why there is nothing to listen on, and what to do."""
_CLOSE = packed({"message": "close"})


class _Guard:
    """Ends what is served once the server is gone, however that ended, as by SIGKILL.

    It is a process that waits for the end of its input. A parent-death signal would come from the thread that starts a
    process, and can only be asked for between fork and exec, where a program of many threads may run no Python.
    """

    def __init__(self) -> None:
        order = [sys.executable, "-I", "-S", "-c", _END_GROUPS]
        self._process = subprocess.Popen(order, stdin=subprocess.PIPE, bufsize=0, process_group=0)

    def toggle(self, group: int) -> None:
        """Tell it a process group that began, or one that has ended."""
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # it was ended
            self._process.stdin.write(f"{group}\n".encode())

    def close(self) -> None:
        """Let it end what is left, and itself."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def _refuse_unusable(address: str, host: str) -> None:
    """Raise InputError, with the reason, where no socket can be bound to host:port; the library of gRPC tells none."""
    number = int(address.rpartition(":")[2])
    failed: OSError | None = None
    try:
        for family, kind, protocol, _, place in socket.getaddrinfo(host, number, type=socket.SOCK_STREAM):
            try:
                with socket.socket(family, kind, protocol) as tried:
                    tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server itself does
                    tried.bind(place)
                return
            except OSError as e:
                failed = e
    except socket.gaierror as e:
        failed = e
    code = failed.errno if failed is not None else None
    why, remedy = _REASONS.get(code, (str(failed), "Give another one."))
    raise InputError("--address", f"cannot listen on {address!r}: {why}", remedy)


class RelayServer:
    """A server of a build's process at an address, host:port; port 0 is any that is free.

    Raises InputError where grpcio is missing, the address is none, or somebody else listens there.
    """

    def __init__(self, program: FunctionProgram, address: str) -> None:
        self._program, self._grpc = program, grpc_library("resim function serve")
        try:
            host = host_of(address)
        except ValueError as e:
            raise InputError("--address", str(e)) from None
        handler = self._grpc.stream_stream_rpc_method_handler(self._drive)
        service, _, method = METHOD.removeprefix("/").partition("/")
        self._server = self._grpc.server(
            ThreadPoolExecutor(STREAMS),
            handlers=[self._grpc.method_handlers_generic_handler(service, {method: handler})],
            options=(*OPTIONS, *_KEPT_ALIVE),
            maximum_concurrent_rpcs=STREAMS,
        )
        _refuse_unusable(address, host)
        try:
            port = self._server.add_insecure_port(address)
        except RuntimeError as e:
            raise InputError("--address", f"cannot listen on {address!r}: {e}", "Give another one.") from None
        self.address = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def serve(self) -> None:
        """Serve until a signal ends the program; then end all processes."""
        try:
            self._server.wait_for_termination()
        finally:
            self.stop()

    def start(self) -> None:
        """Begin to listen."""
        self._guard = _Guard()
        self._server.start()

    def stop(self) -> None:
        """End all streams, and their processes."""
        self._server.stop(grace=None).wait()
        self._guard.close()

    def _drive(self, requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
        """Answer the messages of one run."""
        partner, codes = self._program.partner(grouped=True), self._grpc.StatusCode
        code, why, group = None, "", 0
        try:
            partner.start()
            self._guard.toggle(group := partner.number)
            if not context.add_callback(partner.stop):  # who asked is gone already
                return
            for request in requests:
                message = framed(decode(request))
                if message == _CLOSE:
                    partner.end(message)
                    return
                yield encode(partner.exchange(message))
        except EOFError as e:
            code, why = codes.ABORTED, str(e)
        except FunctionError as e:
            code, why = codes.FAILED_PRECONDITION, str(e)
        except ValueError as e:
            code, why = codes.INVALID_ARGUMENT, f"no Message of function.proto: {e}"
        finally:
            partner.kill()
            if group:
                self._guard.toggle(group)
        if code is not None:
            context.abort(code, why)
