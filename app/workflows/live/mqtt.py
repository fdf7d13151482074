"""What a live session shows, as messages of MQTT for other software."""

import errno
import json
from collections.abc import Callable
from functools import partial
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from furrowmap.core.runtime.errors import MissingExtraError, Notice, UsageError
from furrowmap.core.runtime.languages.texts import Text, Words, reason
from furrowmap.core.runtime.supervised import SupervisedThread

PORTS: Final = {"mqtt": 1883, "mqtts": 8883}
MAX_RECONNECT_S: Final = 10.0
CONNECT_S: Final = 5.0
MQTT_KEEP_ALIVE_S: Final = 15
LOOP_S: Final = 0.05
MAX_ANSWER_BYTES: Final = 1 << 16
"""Nothing is subscribed to, so a broker sends acknowledgements, of some bytes."""
_NOT_CONNECTED: Final = Text("no connection yet")


class MqttOutlet:
    """Publishes to a broker; connects again by itself, and leaves out what cannot be sent at once.

    Args:
        url: mqtt://[USER:PASSWORD@]HOST[:PORT][/TOPIC], or mqtts:// for TLS. Messages have the topics TOPIC/pose and
            TOPIC/figures, and TOPIC/state says "online" or "offline"; TOPIC is "furrowmap" without one.

    Attributes:
        fault: why nothing is sent; None if all is well.

    Raises:
        MissingExtraError: if the package for it is not installed.
        UsageError: if the URL is none.
    """

    def __init__(self, url: str) -> None:
        try:
            parts = urlsplit(url)
            port = parts.port if parts.port is not None else PORTS[parts.scheme]
            (parts.hostname or "").encode("idna")  # as the resolver does
        except (KeyError, ValueError):
            raise UsageError("usage.live-mqtt", url=url) from None
        if not parts.hostname or not port or parts.scheme not in PORTS:
            raise UsageError("usage.live-mqtt", url=url)
        try:
            self._new_client = _client_type()
        except ImportError:
            raise MissingExtraError("paho-mqtt", "cab", Text("MQTT messages are sent by it.")) from None
        self._topic = unquote(parts.path).strip("/") or "furrowmap"
        self._broker = f"{parts.hostname}:{port}"
        self._at = (parts.hostname, port)
        self._is_secure = parts.scheme == "mqtts"
        self._user = (unquote(parts.username), unquote(parts.password or "") or None) if parts.username else None
        self._is_connected = False
        self._waiting: dict[str, str] = {}
        self.fault: Notice | None = Notice("live-mqtt", broker=self._broker, reason=_NOT_CONNECTED)
        self.thread = SupervisedThread("MQTT", self._connect_often, self._ended)
        self.thread.ensure()

    def publish(self, name: str, content: Any) -> None:
        """Send a message, unless there is no connection; one that still waits is replaced."""
        if self._is_connected:
            self._waiting[name] = json.dumps(content, separators=(",", ":"), allow_nan=False)

    def close(self) -> None:
        """Say that the session has ended, and disconnect."""
        self.thread.stop(2.0 * CONNECT_S)

    def _connect_often(self) -> None:
        pause_s = 1.0
        while not self.thread.stopping.is_set():
            try:
                self._serve()
                pause_s = 1.0
            except (OSError, ValueError) as error:  # ValueError: of names and of what a broker answers
                self._is_connected = False
                self._lost(reason(error))
                pause_s = min(2.0 * pause_s, MAX_RECONNECT_S)
            self.thread.stopping.wait(pause_s)

    def _serve(self) -> None:
        """Connect, and send what is published until the connection ends. Raises OSError and ValueError."""
        client = self._new_client()
        if self._is_secure:
            client.tls_set()
        if self._user is not None:
            client.username_pw_set(*self._user)
        client.will_set(f"{self._topic}/state", "offline", retain=True)
        client.on_connect = self._connected
        client.connect_timeout = CONNECT_S
        self._is_connected = False
        try:
            client.connect(*self._at, keepalive=MQTT_KEEP_ALIVE_S)
            while not self.thread.stopping.is_set() and client.loop(LOOP_S) == 0:
                for name in list(self._waiting):
                    text = self._waiting.pop(name)
                    if self._is_connected and not client.want_write():
                        client.publish(f"{self._topic}/{name}", text)
        finally:
            if self.thread.stopping.is_set():
                client.publish(f"{self._topic}/state", "offline", retain=True)
            client.disconnect()
            self._is_connected = False
        self._lost(Text("the connection was lost"))

    def _connected(self, client: Any, _data: object, _flags: object, reason: Any, _properties: object) -> None:
        if reason.is_failure:
            self.fault = Notice("live-mqtt", broker=self._broker, reason=str(reason))
            return
        self.fault = None
        self._is_connected = True
        client.publish(f"{self._topic}/state", "online", retain=True)

    def _lost(self, reason: Words) -> None:
        """The connection has ended; a reason that the broker gave is kept."""
        is_refused = self.fault is not None and ("reason", _NOT_CONNECTED) not in self.fault.values
        if not is_refused and not self.thread.stopping.is_set():
            self.fault = Notice("live-mqtt", broker=self._broker, reason=reason)

    def _ended(self, thread: SupervisedThread) -> None:
        """Whatever a broker sent that ended the thread: it connects again."""
        self._is_connected = False
        self.fault = Notice("live-mqtt", broker=self._broker, reason=thread.cause)


def _client_type() -> Callable[[], Any]:
    """Makes clients that take no more from a broker than answers. Raises ImportError without paho-mqtt."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    class AnswersOnly(Client):
        """A packet may state 256 MB, all of which would be received."""

        def _sock_recv(self, bufsize: int) -> bytes:
            if bufsize > MAX_ANSWER_BYTES:
                raise OSError(errno.EMSGSIZE, "the broker sends what was not asked for")
            return super()._sock_recv(bufsize)

    return partial(AnswersOnly, CallbackAPIVersion.VERSION2)
