"""Serves a process build over gRPC: for each stream a process of its own, whose messages are passed on."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from resim.core.errors import FunctionError, InputError
from resim.function import framed, packed
from resim.simulation.function.grpc_wire import METHOD, OPTIONS, decode, encode, grpc_library, host_of
from resim.simulation.function.program import FunctionProgram

STREAMS = 256
"""Runs that are served at once; more are refused."""
_KEPT_ALIVE = (("grpc.keepalive_time_ms", 60_000), ("grpc.keepalive_permit_without_calls", 1))
"""Who is gone without a word is found out."""
_CLOSE = packed({"message": "close"})


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
        try:
            port = self._server.add_insecure_port(address)
        except RuntimeError:
            raise InputError("--address", f"cannot listen on {address!r}", "Give a free one.") from None
        self.address = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def serve(self) -> None:
        """Serve until a signal ends the program; then end all processes."""
        try:
            self._server.wait_for_termination()
        finally:
            self.stop()

    def start(self) -> None:
        """Begin to listen."""
        self._server.start()

    def stop(self) -> None:
        """End all streams, and their processes."""
        self._server.stop(grace=None).wait()

    def _drive(self, requests: Iterator[bytes], context: Any) -> Iterator[bytes]:
        """Answer the messages of one run."""
        partner, codes = self._program.partner(grouped=True), self._grpc.StatusCode
        code, why = None, ""
        try:
            partner.start()
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
        if code is not None:
            context.abort(code, why)
