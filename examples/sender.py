"""A sender over TCP: ten blocks of 5 s; docs/reference/wire.md has the protocol."""

import json
import socket
import struct
import time

import numpy as np
from google_crc32c import value as crc32c  # or any other CRC-32C library

sock = socket.create_connection(("127.0.0.1", 5777))
sock.sendall(b"SPWH" + struct.pack("<HH", 1, 5) + b"press")
(committed,) = struct.unpack("<Q", sock.recv(8, socket.MSG_WAITALL))
header = json.dumps({"channels": ["de"], "units": ["g"], "scale": 0.001, "speed_hz": 30.0}).encode()
for sequence in range(committed + 1, committed + 11):
    samples = np.zeros((1, 128000), dtype="<i2")  # 5 s at 25.6 kHz
    body = struct.pack("<4sHHQdIBqH", b"SPW1", 1, 1, sequence, 25600.0, 128000, 1, time.time_ns(), len(header))
    body += header + samples.tobytes()
    sock.sendall(body + struct.pack("<I", crc32c(body)))
    (committed,) = struct.unpack("<Q", sock.recv(8, socket.MSG_WAITALL))
sock.close()
