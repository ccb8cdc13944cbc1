#!/usr/bin/python3
"""Pack one message of every type with Python's struct: an implementation of the wire format independent of wire.cpp.

Example: golden_messages.py > golden_messages.inc

The layout is that of common/coupling/wire.hpp and handshake.hpp. The output is committed; it changes only when the
protocol's version does.
"""
import argparse
import struct


def crc32c(data):
    """CRC-32C bit by bit (RFC 3720, reflected polynomial 0x82F63B78)."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def string(text):
    raw = text.encode()
    return struct.pack("<I", len(raw)) + raw


def strings(texts):
    return struct.pack("<Q", len(texts)) + b"".join(string(t) for t in texts)


def array(code, values):
    return struct.pack("<Q", len(values)) + struct.pack(f"<{len(values)}{code}", *values)


def message(number, payload):
    """Header as every golden message has it: sequence 5, window 41, t = 0.25, dt = 0.125."""
    head = struct.pack("<4sHHQqddQ", b"UND1", number, 0, 5, 41, 0.25, 0.125, len(payload))
    tail = bytes(12)
    crc = crc32c(head + bytes(4) + tail + payload)
    return head + struct.pack("<I", crc) + tail + payload


def messages():
    mesh = (struct.pack("<iI", 2, 3) + strings(["gate", "bed"]) + array("q", [11, 7, 2**40])
            + array("d", [0.0, 1.0, 0.5, 1.5, 1.0, 2.0])
            + array("d", [1.0, 0.0, 0.0, 1.0, 2.0, 0.5, 0.5, 2.0, 0.0, 0.0, 0.0, 4.0])
            + array("i", [0, 2, 4]) + array("i", [0, 1, 1, 2]) + array("i", [0, 1]))
    thin_wall = mesh + array("i", [0, 2]) + array("d", [0.5, 0.25, -0.25, 0.125])  # nodes that move each other
    several_ranks = mesh + array("i", []) + array("d", []) + array("i", [1, 0, 2])  # who sends and receives each row
    vector = struct.pack("<6d", 0.0, -1.0, 2.5, 1e-300, 1e300, -0.0)
    return {
        "setup": message(1, struct.pack("<idd", 2, 0.5, 1.5) + string("gc") + strings(["gate", "bed"]) + string("")),
        "mesh": message(2, mesh),
        "mesh_of_a_thin_wall": message(2, thin_wall),
        "mesh_of_several_ranks": message(2, several_ranks),
        "mesh_reply": message(3, struct.pack("<B", 0) + string("gap of 2 mm")),
        "ready": message(4, struct.pack("<9dqB", 1e-4, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1)),
        "window": message(5, struct.pack("<qddqBBBB", 41, 0.25, 0.5, 7, 1, 0, 1, 0)),
        "window_on_trial": message(5, struct.pack("<qddqBBBB", 41, 0.25, 0.5, 7, 1 | 2, 0, 1, 0)),
        "window_in_flight": message(5, struct.pack("<qddqBBBB", 41, 0.25, 0.5, 7, 1 | 4, 0, 1, 0)),
        "free_velocity": message(6, vector),
        "link_force": message(7, vector),
        "mesh_update": message(8, mesh),
        "checkpoint": message(9, string("out/checkpoints/000007") + string("000007") + struct.pack("<qd", 41, 0.25)),
        "checkpoint_done": message(10, struct.pack("<B", 0) + string("disk full") + strings(["solid.h5"])),
        "stop_request": message(11, string("SIGTERM")),
        "bye": message(12, string("")),
        "bye_ack": message(13, b""),
        "fail": message(14, struct.pack("<i", 10) + string("element 17 is inverted")),
        "ping": message(15, b""),
        "kinematics": message(16, array("d", [1.0, 2.0]) + array("d", [3.0, 4.0])),
        "surface": message(18, mesh),
        "motion": message(19, array("d", [0.5, 0.25]) + array("d", [3.0, 4.0])),
        "activation_impulse": message(17, array("d", [5.0, 6.0]) + array("d", [7.0, 8.0])),
        "hello": (b"\x89FSI\r\n\x1a\n" + struct.pack("<HHIBBBQQii", 1, 0, 0x01020304, 4, 8, 2, 6, 0x1122334455667788, 3, 4711)
                  + b"solid".ljust(32, b"\0") + b"GetFEM 5.4.2".ljust(96, b"\0") + b"node7".ljust(64, b"\0")
                  + b"coupler".ljust(128, b"\0")).ljust(512, b"\0"),
        "roster": (b"\x89FSR\r\n\x1a\n" + struct.pack("<HHi", 1, 0, 0) + string("") + struct.pack("<Q", 2)
                   + string("coupler") + string("undine 0.1.0") + string("node1") + struct.pack("<Q", 0)
                   + string("solid") + string("GetFEM 5.4.2") + string("node7") + struct.pack("<Q", 6)),
        "roster_with_error": (b"\x89FSR\r\n\x1a\n" + struct.pack("<HHi", 1, 0, 35)
                              + string("no program with role 'solid'")),
    }


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print("// One message of every type in hexadecimal, packed by golden_messages.py.")
    for name, data in messages().items():
        text = data.hex()
        lines = [text[i:i + 96] for i in range(0, len(text), 96)]
        print(f"\n// {name}: {len(data)} bytes\nconst char* const {name} =")
        print("\n".join(f'    "{line}"' for line in lines) + ";")


if __name__ == "__main__":
    main()
