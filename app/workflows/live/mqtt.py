"""What a live session shows, as messages of MQTT for other software."""

import json
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from furrowmap.core.runtime.errors import Notice, RefusedError, UsageError

PORTS: Final = {"mqtt": 1883, "mqtts": 8883}
MAX_RECONNECT_S: Final = 10


class MqttOutlet:
    """Publishes to a broker; connects again by itself, and leaves out what cannot be sent at once.

    Args:
        url: mqtt://[USER:PASSWORD@]HOST[:PORT][/TOPIC], or mqtts:// for TLS. Messages have the topics TOPIC/pose and
            TOPIC/figures, and TOPIC/state says "online" or "offline"; TOPIC is "furrowmap" without one.

    Attributes:
        fault: why nothing is sent; None if all is well.

    Raises:
        RefusedError: if the package for it is not installed.
        UsageError: if the URL is none.
    """

    def __init__(self, url: str) -> None:
        try:
            parts = urlsplit(url)
            port = parts.port or PORTS[parts.scheme]
        except (KeyError, ValueError):
            raise UsageError("usage.live-mqtt", url=url) from None
        if not parts.hostname:
            raise UsageError("usage.live-mqtt", url=url)
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError:
            raise RefusedError("extra-missing.cab", package="paho-mqtt") from None
        self._topic = unquote(parts.path).strip("/") or "furrowmap"
        self._broker = f"{parts.hostname}:{port}"
        self.fault: Notice | None = Notice("live-mqtt", broker=self._broker, reason="no connection yet")
        self._client = client = Client(CallbackAPIVersion.VERSION2)
        if parts.scheme == "mqtts":
            client.tls_set()
        if parts.username:
            client.username_pw_set(unquote(parts.username), unquote(parts.password or "") or None)
        client.will_set(f"{self._topic}/state", "offline", retain=True)
        client.on_connect = self._connected
        client.on_disconnect = self._gone
        client.reconnect_delay_set(1, MAX_RECONNECT_S)
        client.connect_async(parts.hostname, port, keepalive=15)
        client.loop_start()

    def publish(self, name: str, content: Any) -> None:
        """Send a message, unless there is no connection or an earlier one still waits."""
        if self._client.is_connected() and not self._client.want_write():
            self._client.publish(f"{self._topic}/{name}", json.dumps(content, separators=(",", ":"), allow_nan=False))

    def close(self) -> None:
        """Say that the session has ended, and disconnect."""
        self._client.publish(f"{self._topic}/state", "offline", retain=True)
        self._client.disconnect()
        self._client.loop_stop()

    def _connected(self, client: Any, _data: object, _flags: object, reason: Any, _properties: object) -> None:
        if reason.is_failure:
            self.fault = Notice("live-mqtt", broker=self._broker, reason=str(reason))
            return
        self.fault = None
        client.publish(f"{self._topic}/state", "online", retain=True)

    def _gone(self, *_: object) -> None:
        self.fault = self.fault or Notice("live-mqtt", broker=self._broker, reason="the connection was lost")
