"""The server: the page, and one WebSocket for each browser. README.md in this folder states its messages."""

from __future__ import annotations

import asyncio
import ipaddress
import signal
import socket as sockets
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import orjson
import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from harness.addresses import LOCALHOST
from harness.station.desk import OrderError
from harness.station.draft import as_json, from_json, place_of
from harness.station.guard import SUBPROTOCOL, Guard, token_of
from harness.station.mission_files import MAX_BYTES, read, write
from harness.station.proposals import MAX_BYTES as MAP_BYTES
from harness.station.proposals import Proposals
from harness.station.shown import (
    MESSAGE_BYTES,
    MESSAGES_PER_S,
    POLL_S,
    Shown,
    error_message,
    event_message,
)
from models.errors import CanineError, UsageError

STATIC = Path(__file__).parent / "static"
PARTS = Path(__file__).parents[1] / "report" / "parts"
MOST_OPERATORS = 16
WAITING = 256  # messages that wait for a slow browser, beside the last state
AHEAD = 4096  # bytes that a browser's socket takes before the network does
SEND_S = 10.0  # s after which a browser that takes nothing is left
MOST_IDLE = 4 * MOST_OPERATORS  # connections that ask for nothing; half of those that may be open
HEAD_S = 5.0  # s in which a connection states what it asks for
BODY_S = 20.0  # s in which a file comes, and more by its bytes; slow ones would else take all connections
LEAST_RATE = 16_000  # bytes of a file that come in each further second
FAREWELL_S = 1.0  # s for which a socket that is turned out stays open
PIECE = 4096  # bytes of a socket that are looked at before its frames are counted
BURST = 2 * MESSAGES_PER_S
Page = Callable[[], bytes]
TRY_LATER, POLICY = 1013, 1008  # codes with which a socket is closed
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Outbox:
    """What waits for a browser: the last state alone, and some other messages. A slow one harms nobody."""

    def __init__(self) -> None:
        self._state: bytes | None = None
        self._others: deque[bytes] = deque()
        self._left_out = 0
        self._filled = asyncio.Event()

    def show(self, state: bytes) -> None:
        """A state, in the place of the one that waits."""
        self._state = state
        self._filled.set()

    def put(self, message: bytes) -> None:
        """Another message; the oldest makes room for it."""
        if len(self._others) == WAITING:
            self._others.popleft()
            self._left_out += 1
        self._others.append(message)
        self._filled.set()

    async def take(self) -> list[bytes]:
        """What waits, once there is something."""
        await self._filled.wait()
        self._filled.clear()
        messages, self._others = list(self._others), deque()
        if self._left_out:
            text = f"{self._left_out} messages were left out, since this browser is too slow"
            messages.insert(0, error_message(text))
            self._left_out = 0
        if self._state is not None:
            messages.append(self._state)
            self._state = None
        return messages


class _Http(H11Protocol):
    """A connection that asks for nothing within HEAD_S is closed, however many bytes of a head it sends.

    As many as may be open would else lock everybody out. If more than MOST_IDLE ask for nothing, the oldest
    of them is closed at once: a flood of them pushes out its own.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._since = self.loop.time()
        self.loop.call_later(HEAD_S, self._leave, None)
        idle = [other for other in self.connections if isinstance(other, _Http) and other.is_idle]
        if len(idle) > MOST_IDLE:
            min(idle, key=lambda other: other._since).transport.abort()

    @property
    def is_idle(self) -> bool:
        """Is nothing asked for?"""
        is_answered = self.cycle is None or self.cycle.response_complete
        return is_answered and not self.transport.is_closing()

    def on_response_complete(self) -> None:
        answered, self._since = self.cycle, self.loop.time()
        super().on_response_complete()
        self.loop.call_later(HEAD_S, self._leave, answered)

    def _leave(self, answered: object) -> None:
        """Close, if no request came since. A browser's socket has left the `connections`, and stays."""
        if self.cycle is answered and self in self.connections:
            self.transport.close()


class Rate:
    """Counts what a browser sends: MESSAGES_PER_S, and BURST of them at once."""

    def __init__(self) -> None:
        self._room, self._at = float(BURST), time.monotonic()

    def allows(self) -> bool:
        """May another one come?"""
        now = time.monotonic()
        self._room = min(BURST, self._room + (now - self._at) * MESSAGES_PER_S)
        self._at = now
        self._room -= 1
        return self._room >= 0


class _Socket(WebSocketsSansIOProtocol):
    """A browser's socket, which takes little ahead of the network: what is left waits in the outbox.

    In the buffers of socket and system hundreds of states would wait, and a slow browser would show what was.
    Each frame counts as a message: a flood of pings or of empty pieces holds up the loop as well.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=AHEAD)
        if hasattr(sockets, "TCP_NOTSENT_LOWAT"):  # not every system has it
            socket = transport.get_extra_info("socket")
            socket.setsockopt(sockets.IPPROTO_TCP, sockets.TCP_NOTSENT_LOWAT, AHEAD)
        self._rate = Rate()

    def data_received(self, data: bytes) -> None:
        for start in range(0, len(data), PIECE):
            if not self.transport.is_closing():
                super().data_received(data[start : start + PIECE])

    def handle_events(self) -> None:
        if all(self._rate.allows() for _ in self.conn.events):
            super().handle_events()
        else:
            self.conn.events_received()  # which are thrown away, not counted again with the next piece
            self._turn_out(f"more than {MESSAGES_PER_S} messages a second")

    def handle_text(self, event: Frame) -> None:
        """As bytes: `_order` refuses what is not text."""
        self.handle_bytes(event)

    def _turn_out(self, why: str) -> None:
        """Close; what still comes is thrown away, so that the browser has the time to hear why."""
        self.conn.fail(POLICY, why)
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.queue.put_nowait({"type": "websocket.disconnect", "code": POLICY, "reason": why})
        self.close_timer = self.loop.call_later(FAREWELL_S, self.transport.close)


class Station:
    """Serves what is shown to browsers.

    Args:
        shown: a station at work, a log that is played, or a trial that runs.
        guard: who may come in.
        page: gives the page, which states its own policy; by default the station's.
    """

    def __init__(self, shown: Shown, guard: Guard, page: Page | None = None) -> None:
        self.shown, self.guard, self._own_page = shown, guard, page
        self._outboxes: dict[int, Outbox] = {}
        self._proposals = Proposals()
        self._reading = asyncio.Lock()  # a file at a time
        self._operators = 0
        routes = [
            Route("/", self._page),
            Route("/import", self._import, methods=["POST"]),
            Route("/export", self._export, methods=["POST"]),
            Route("/routes", self._routes, methods=["POST"]),
            WebSocketRoute("/ws", self._socket),
            Mount("/static", StaticFiles(directory=STATIC, check_dir=False)),
            Mount("/parts", StaticFiles(directory=PARTS, check_dir=False)),
        ]
        self.app: ASGIApp = _Guarded(Starlette(routes=routes), guard)

    async def work(self) -> None:
        """Look at the port again and again, and tell the browsers what is new."""
        while True:
            news = self.shown.poll()
            messages = [event_message(event) for event in news.events]
            for outbox in self._outboxes.values():
                for message in messages:
                    outbox.put(message)
                if news.state is not None:
                    outbox.show(news.state)
            await asyncio.sleep(POLL_S)

    async def _page(self, request: Request) -> Response:
        if self._own_page is None:
            return FileResponse(STATIC / "index.html")
        return HTMLResponse(self._own_page(), headers={"content-security-policy": "frame-ancestors 'none'"})

    async def _import(self, request: Request) -> Response:
        if response := self._refused(request):
            return response
        try:
            data = await _body(request, "file", MAX_BYTES)
            async with self._reading:
                # not on the loop, which keeps the vest's operator alive: a large file takes a second
                draft = await asyncio.to_thread(read, request.query_params.get("name", ""), data)
            return JSONResponse(as_json(draft))
        except CanineError as reason:
            return _error(str(reason))

    async def _export(self, request: Request) -> Response:
        if response := self._refused(request):
            return response
        to = request.query_params.get("to", "")
        try:
            content = orjson.loads(await _body(request, "mission", MESSAGE_BYTES))
            mission = content.get("mission") if isinstance(content, dict) else None
            written = write(from_json(mission), to)
        except orjson.JSONDecodeError as reason:
            return _error(f"the mission is no JSON ({reason})")
        except CanineError as reason:
            return _error(str(reason))
        disposition = {"content-disposition": f'attachment; filename="mission.{to}"'}
        return Response(written, media_type="application/octet-stream", headers=disposition)

    async def _routes(self, request: Request) -> Response:
        if response := self._refused(request):
            return response
        asked = request.query_params
        try:
            begin, end = (place_of(key, *asked.get(key, "").partition(",")[::2]) for key in ("from", "to"))
            data = await _body(request, "map", MAP_BYTES)
            return JSONResponse(await self._proposals.ask(asked.get("name", ""), data, begin, end))
        except CanineError as reason:
            return _error(str(reason))

    def _refused(self, request: Request) -> Response | None:
        why = self.guard.refusal(request.headers, request.headers.get("x-token", ""))
        return JSONResponse({"error": why}, 403) if why else None

    async def _socket(self, browser: WebSocket) -> None:
        if self.guard.refusal(browser.headers, token_of(browser.scope["subprotocols"])):
            await browser.close(POLICY)  # before it is accepted: 403
            return
        carries = SUBPROTOCOL in browser.scope["subprotocols"]
        await browser.accept(SUBPROTOCOL if carries else None)
        if len(self._outboxes) >= MOST_OPERATORS:
            text = f"{MOST_OPERATORS} browsers are connected, the most there may be"
            with suppress(RuntimeError, WebSocketDisconnect):  # it is closed already
                await browser.close(TRY_LATER, text)
            return
        self._operators += 1
        operator, outbox = self._operators, Outbox()
        for message in self.shown.join(operator):
            outbox.put(message)
        self._outboxes[operator] = outbox
        sender = asyncio.create_task(_send(browser, outbox))
        receiver = asyncio.create_task(self._receive(browser, operator, outbox))
        try:
            await asyncio.wait((sender, receiver), return_when=asyncio.FIRST_COMPLETED)
        finally:
            del self._outboxes[operator]
            self.shown.leave(operator)
            for task in (sender, receiver):
                task.cancel()
            results = await asyncio.gather(sender, receiver, return_exceptions=True)
        for result in results:
            if isinstance(result, Exception):
                raise result

    async def _receive(self, browser: WebSocket, operator: int, outbox: Outbox) -> None:
        while True:
            message = await browser.receive()
            if message["type"] != "websocket.receive":
                return
            try:
                for answer in self.shown.order(operator, _order(message["bytes"])):
                    outbox.put(answer)
            except OrderError as reason:
                outbox.put(error_message(str(reason)))


def _order(message: bytes) -> dict[str, Any]:
    """A browser's order.

    Raises:
        OrderError: the message is no JSON object.
    """
    expected = 'expected a JSON object such as {"do": "alive"}'
    try:
        order = orjson.loads(message)
    except orjson.JSONDecodeError as reason:
        raise OrderError(f"the message is no JSON ({reason}); {expected}") from None
    if not isinstance(order, dict):
        raise OrderError(f"the message is a {type(order).__name__}; {expected}")
    return order


async def _send(browser: WebSocket, outbox: Outbox) -> None:
    """Send what waits, until the browser is gone, or takes nothing for SEND_S."""
    while True:
        for message in await outbox.take():
            try:
                async with asyncio.timeout(SEND_S):
                    await browser.send_text(message.decode())
            except (WebSocketDisconnect, TimeoutError, RuntimeError):  # the last one: it is closed already
                return


async def _body(request: Request, what: str, most: int) -> bytes:
    """The body of a request.

    Raises:
        UsageError: it has more bytes than `most`, or comes slower than BODY_S and LEAST_RATE allow.
    """
    data = bytearray()
    begun = asyncio.get_running_loop().time()
    try:
        async with asyncio.timeout(BODY_S) as limit:
            async for part in request.stream():
                data += part
                if len(data) > most:
                    raise UsageError(f"the {what} has more than {most} bytes")
                limit.reschedule(begun + BODY_S + len(data) / LEAST_RATE)
    except TimeoutError:
        took = BODY_S + len(data) / LEAST_RATE
        raise UsageError(
            f"the {what} did not come within {took:.3g} s: the link is too slow, expected "
            f"{LEAST_RATE / 1000:g} kB a second at least; send it again over a faster one"
        ) from None
    except ClientDisconnect:
        raise UsageError(f"the {what} was cut; send it again") from None
    return bytes(data)


def _error(text: str) -> Response:
    return JSONResponse({"error": text}, 400)


class _Guarded:
    """Refuses requests for other hosts, and adds the headers that keep a page to itself."""

    def __init__(self, app: ASGIApp, guard: Guard) -> None:
        self._app, self._guard = app, guard

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        if why := self._guard.refusal_of_host(Request(scope).headers):
            await PlainTextResponse(why, 403)(scope, receive, guarded)
        else:
            await self._app(scope, receive, guarded)


@contextmanager
def listening(bind: str, number: int) -> Iterator[sockets.socket]:
    """A socket that listens; port 0 takes any that is free.

    Raises:
        UsageError: the address is not this machine's, or the port is taken.
    """
    try:
        family, kind, protocol, _, address = sockets.getaddrinfo(bind, number, type=sockets.SOCK_STREAM)[0]
        listener = sockets.socket(family, kind, protocol)
    except (OSError, UnicodeError) as reason:
        raise UsageError(f"--bind {bind}: no address of this machine ({reason})") from None
    with listener:
        listener.setsockopt(sockets.SOL_SOCKET, sockets.SO_REUSEADDR, 1)
        try:
            listener.bind(address)
            listener.listen()
        except OSError as reason:
            raise UsageError(
                f"--bind {bind} --http-port {number}: cannot be listened on ({reason.strerror}); "
                "choose another port, or 0 for any that is free"
            ) from None
        yield listener


def address_of(listener: sockets.socket, guard: Guard) -> str:
    """What a browser opens; the token is in the fragment, which browsers do not send."""
    host, number = listener.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    if guard.bind in ("localhost", LOCALHOST):
        shown = "localhost"
    elif ipaddress.ip_address(host).is_unspecified:  # any address of this machine
        shown = sockets.gethostname()
    return f"http://{shown}:{number}/" + (f"#token={guard.token}" if guard.token else "")


class _Server(uvicorn.Server):
    """Ends at a signal without raising it in its loop, whose threads would then never be joined.

    Attributes:
        ended_by: the signal's number; None for none.
    """

    ended_by: int | None = None

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """As uvicorn's, and SIGHUP too."""
        is_main = threading.current_thread() is threading.main_thread()
        hung_up = signal.getsignal(signal.SIGHUP)
        with super().capture_signals():
            if is_main and hung_up is not signal.SIG_IGN:
                signal.signal(signal.SIGHUP, self.handle_exit)
            try:
                yield
            finally:
                if is_main:
                    signal.signal(signal.SIGHUP, hung_up)
                self.ended_by = next(iter(self._captured_signals), None)
                self._captured_signals.clear()


async def serve(
    shown: Shown,
    guard: Guard,
    listener: sockets.socket,
    ready: Callable[[uvicorn.Server], None] = lambda server: None,
    page: Page | None = None,
) -> int | None:
    """Serve until the server is told to end (`should_exit`), or a signal ends it, whose number is returned.

    Args:
        ready: is given the server, once it answers.
        page: as `Station` takes it.
    """
    station = Station(shown, guard, page)
    config = uvicorn.Config(
        station.app,
        lifespan="off",
        log_level="error",
        access_log=False,
        server_header=False,
        http=_Http,
        ws=_Socket,
        ws_max_size=MESSAGE_BYTES,
        ws_per_message_deflate=False,
        h11_max_incomplete_event_size=MESSAGE_BYTES,
        limit_concurrency=8 * MOST_OPERATORS,
        timeout_graceful_shutdown=2,
    )
    server = _Server(config)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    work = asyncio.create_task(station.work())
    try:
        while not server.started and not serving.done():
            await asyncio.sleep(POLL_S)
        if server.started:
            ready(server)
        await asyncio.wait((serving, work), return_when=asyncio.FIRST_COMPLETED)
    finally:
        server.should_exit = True
        work.cancel()
        with suppress(asyncio.CancelledError):
            await work
        await serving
    return server.ended_by
