"""A hand on a virtual screen, by the X protocol and its own test extension."""

import socket
import struct

_MOTION, _PRESS, _RELEASE = 6, 4, 5


class XClient:
    """A hand on a display: its pointer moved and pressed, its windows asked to close, by the X protocol itself."""

    def __init__(self, display: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(f"/tmp/.X11-unix/X{display.lstrip(':')}")
        self._socket.sendall(struct.pack("<BxHHHHxx", ord("l"), 11, 0, 0, 0))
        head = self._take(8)
        assert head[0] == 1, "the X server refused"
        setup = self._take(4 * struct.unpack("<H", head[6:8])[0])
        vendor, num_formats = struct.unpack_from("<H", setup, 16)[0], setup[21]
        self._root = struct.unpack_from("<I", setup, 32 + -(-vendor // 4) * 4 + 8 * num_formats)[0]
        name = b"XTEST"
        self._socket.sendall(struct.pack("<BxHHxx", 98, 2 + (len(name) + 3) // 4, len(name)) + name.ljust(8, b"\0"))
        answer = self._take(32)
        assert answer[8], "the X server has no XTEST"
        self._opcode = answer[9]

    def move(self, x: float, y: float) -> None:
        self._fake(_MOTION, 0, round(x), round(y))

    def press(self, button: int = 1) -> None:
        self._fake(_PRESS, button)

    def release(self, button: int = 1) -> None:
        self._fake(_RELEASE, button)

    def windows(self) -> list[int]:
        """The windows on the screen; without a window manager they stand directly on its root."""
        self._socket.sendall(struct.pack("<BxHI", 15, 2, self._root))
        answer = self._take(32)
        num = struct.unpack_from("<H", answer, 16)[0]
        return list(struct.unpack(f"<{num}I", self._take(4 * num)))

    def ask_to_close(self, window: int) -> None:
        """What a window manager sends when somebody clicks the cross."""
        protocols, delete = (self._atom(name) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW"))
        event = struct.pack("<BBHIIIIIII", 33, 32, 0, window, protocols, delete, 0, 0, 0, 0)
        self._socket.sendall(struct.pack("<BBHII", 25, 0, 11, window, 0) + event)

    def close(self) -> None:
        """Once the server has heard what was said: a hand that leaves at once is not listened to."""
        self._atom(b"WM_PROTOCOLS")
        self._socket.close()

    def _atom(self, name: bytes) -> int:
        padded = name.ljust(-(-len(name) // 4) * 4, b"\0")
        self._socket.sendall(struct.pack("<BBHHxx", 16, 0, 2 + len(padded) // 4, len(name)) + padded)
        return struct.unpack_from("<I", self._take(32), 8)[0]

    def _fake(self, kind: int, detail: int, x: int = 0, y: int = 0) -> None:
        event = struct.pack("<BBHIIIIhhIHBB", kind, detail, 0, 0, 0, 0, 0, x, y, 0, 0, 0, 0)
        self._socket.sendall(struct.pack("<BBH", self._opcode, 2, 9) + event)

    def _take(self, num: int) -> bytes:
        data = b""
        while len(data) < num:
            part = self._socket.recv(num - len(data))
            assert part, "the X server is gone"
            data += part
        return data
