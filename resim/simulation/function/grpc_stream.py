"""A function that is asked over gRPC, as one in a container is: a stream for each run, which ends with it.

The messages are those of a process (docs/formats/process.md). Who serves them may be `resim function serve`
(`relay`), or any other server of `resim/function/function.proto`.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

from pydantic import BaseModel, ConfigDict, StrictBool, StrictStr, model_validator

from resim.core.errors import FunctionError
from resim.core.plugins.unlisted_files import NOT_PINNED, unheard
from resim.simulation.function.grpc_wire import METHOD, OPTIONS, decode, encode, grpc_library, is_loopback

_ENDING = 10.0
"""s that a stream has to end after `close`; a relayed process has 5 s of them."""


class GrpcTable(BaseModel):
    """`[grpc]`: where the function is asked.

    Attributes:
        address: host:port of its server.
        remote: Whether the address may be of another machine; nothing is encrypted.
        digest: Of the container that serves there, for the hash and the results; nobody checks it.
        batches: Whether it answers `reset_batch` and `step_batch`.
    """

    model_config = ConfigDict(extra="forbid")
    address: StrictStr
    remote: StrictBool = False
    digest: StrictStr = ""
    batches: StrictBool = False

    @model_validator(mode="after")
    def _is_near_or_remote(self) -> GrpcTable:
        if not is_loopback(self.address) and not self.remote:
            raise ValueError(
                f"address {self.address!r} is not on this machine's loopback, expected remote = true to allow that; "
                "nothing is encrypted"
            )
        return self


@dataclass(frozen=True)
class GrpcProgram:
    """A function that is served elsewhere.

    Attributes:
        address: host:port of its server.
        digest: Of the container that is said to serve there; "" for none.
    """

    address: str
    digest: str = ""

    def partner(self) -> StreamPartner:
        """Give a stream for one run."""
        return StreamPartner(self.address)

    @property
    def unpinned(self) -> str:
        """That the hash does not cover who answers, in words."""
        what = f"whether container {self.digest} is what answers" if self.digest else "what answers"
        return f"{what} at {self.address} {NOT_PINNED}"


class StreamPartner:
    """A stream, as the partner of a conversation (`resim.simulation.function.messages.Partner`)."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._grpc: Any = None
        self._channel: Any = None
        self._stream: Any = None
        self._asked: SimpleQueue[bytes | None] = SimpleQueue()
        self._told: SimpleQueue[Any] = SimpleQueue()
        self._reader: threading.Thread | None = None
        self._answered = self._closing = False

    def start(self) -> None:
        """Open the stream; whether a server answers is known with the first message."""
        with unheard():
            self._grpc = grpc_library("[grpc]")
            self._channel = self._grpc.insecure_channel(self._address, options=OPTIONS)
            drive = self._channel.stream_stream(METHOD)
            self._asked, self._told = SimpleQueue(), SimpleQueue()
            self._answered = self._closing = False
            self._stream = drive(iter(self._asked.get, None))
            order = (self._stream, self._told, self._grpc.RpcError)
            self._reader = threading.Thread(target=_read, args=order, daemon=True)
            self._reader.start()

    def exchange(self, message: bytes) -> bytes:
        """Send a message, its length before it, and give the body of its answer."""
        if self._stream is None:
            raise FunctionError("was asked when it had ended")
        early = (
            not self._told.empty()
        )  # taken for the answer, it would make each the one to the question before
        if not early:
            self._asked.put(encode(message[4:]))
        answer = self._next()
        if answer is None:
            raise EOFError("ended its stream with OK")
        if early:
            raise FunctionError("wrote more than one answer to a message")
        self._answered = True
        return _body(answer)

    def end(self, message: bytes) -> None:
        """Send the last message; FunctionError where the stream does not end by itself, or ends with an error."""
        if self._stream is None:
            return
        self._closing = True
        late = threading.Timer(_ENDING, self._stream.cancel)
        late.start()
        try:
            self._asked.put(encode(message[4:]))
            self._asked.put(None)
            if self._next() is not None:
                raise FunctionError("wrote more than one answer to a message")
        except EOFError as e:
            raise FunctionError(str(e)) from None
        finally:
            late.cancel()
            self.kill()

    def kill(self) -> None:
        """End the stream and its connection, whatever happens."""
        stream, channel = self._stream, self._channel
        self._stream = self._channel = None
        self._asked.put(None)  # lets the thread go that sends
        if stream is not None:
            stream.cancel()
        if channel is not None:
            channel.close()
        if self._reader is not None:
            self._reader.join(_ENDING)
            self._reader = None

    def _next(self) -> bytes | None:
        """The next message of the stream, None at its end."""
        told = self._told.get()
        if isinstance(told, self._grpc.RpcError):
            self._told.put(told)  # whoever asks again is told the same
            raise self._failure(told.code(), told.details() or "")
        answer: bytes | None = told
        return answer

    def _failure(self, code: Any, details: str) -> Exception:
        """What a stream's status says: how a function ended, or that nobody is there."""
        codes = self._grpc.StatusCode
        if code == codes.ABORTED and details:  # a relayed process has ended
            return EOFError(f"{details:.300}")
        if code == codes.FAILED_PRECONDITION and details:
            return FunctionError(f"{details:.300}")
        if code == codes.UNAVAILABLE and not self._answered:
            return FunctionError(
                f"cannot be reached: no server answers at {self._address} ({details:.200}). "
                "Start it, such as with `resim function serve`"
            )
        if code == codes.UNAVAILABLE:
            return FunctionError(f"was lost: the connection to {self._address} broke ({details:.200})")
        if code == codes.CANCELLED and self._closing:
            return FunctionError(f"did not end its stream within {_ENDING:g} s of the message 'close'")
        return EOFError(f"ended its stream with {code.name}: {details or 'no reason given':.200}")


def _read(stream: Any, told: SimpleQueue[Any], failed: type[Exception]) -> None:
    """Read a stream: its messages, then None at its end, or why it failed.

    No further where more than one waits, of which one was not asked for: it may be a flood.
    """
    try:
        for answer in stream:
            told.put(answer)
            if told.qsize() > 1:
                return
        told.put(None)
    except failed as e:
        told.put(e)


def _body(answer: bytes) -> bytes:
    try:
        return decode(answer)
    except ValueError as e:
        raise FunctionError(f"answered what is no Message of function.proto: {e}") from None
