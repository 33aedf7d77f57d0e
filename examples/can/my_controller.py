"""A steering controller of your own on the bus of `examples/can/hil.yaml`, without a line of swath.

    python examples/can/my_controller.py $(swath can dbc) &
    swath run examples/can/hil.yaml

It needs python-can and cantools. It reads the crop edge and answers each cycle of the machine with the
curvature that takes the left end of the header back to the edge over PREVIEW metres. Curvature on the bus is
in 1/km and positive to the right; the crop edge is in metres and radians and positive to the left.
"""

import argparse
import math

import can
import cantools

ADDRESS, GLOBAL = 28, 255
KNIFE_X, HEADER_END_Y = 4.0, 6.0  # of the header's left end against the fixed axle [m]
OVERLAP, PREVIEW = 0.10, 4.0  # [m]
STATUS, COMMAND, EDGE_LINE, EDGE_QUALITY, WHEEL = 0xAC00, 0xAD00, 0xFF5A, 0xFF5B, 0xFE48
REQUEST, ADDRESS_CLAIMED = 0xEA00, 0xEE00


def identifier(pgn: int, priority: int) -> int:
    """29 bits: priority, parameter group with the destination where it has one, source address."""
    destination = GLOBAL if pgn >> 8 & 0xFF < 240 else 0
    return priority << 26 | (pgn | destination) << 8 | ADDRESS


def pgn_of(arbitration_id: int) -> int:
    pgn = arbitration_id >> 8 & 0x3FFFF
    return pgn & 0x3FF00 if pgn >> 8 & 0xFF < 240 else pgn


def wanted_curvature(edge: dict[str, float]) -> float:
    """1/m, > 0 left."""
    back = KNIFE_X - edge["EdgeReference"]  # from where the edge is known to where the header is
    slope, bend = math.tan(edge["EdgeHeading"]), edge["EdgeCurvature"]
    error = edge["EdgeOffset"] + back * (slope + 0.5 * bend * back) - HEADER_END_Y + OVERLAP
    course = math.tan(math.atan(slope + bend * back) + math.atan(error / PREVIEW))
    return course / (KNIFE_X + HEADER_END_Y * course)


def main() -> None:
    parser = argparse.ArgumentParser(description="a steering controller on CAN")
    parser.add_argument("dbc")
    parser.add_argument("--interface", default="udp_multicast")
    parser.add_argument("--channel", default="239.74.163.2")
    parser.add_argument("--port", type=int, help="of udp_multicast")
    args = parser.parse_args()
    options = {"fd": False} if args.interface == "udp_multicast" else {}
    if args.port:
        options["port"] = args.port
    database = cantools.database.load_file(args.dbc)
    command = database.get_message_by_name("GuidanceSystemCommand")
    line = database.get_message_by_name("CropEdgeLine")
    edge, must_release, was_on = None, False, False

    with can.Bus(interface=args.interface, channel=args.channel, **options) as bus:
        for frame in bus:
            if not frame.is_extended_id or frame.arbitration_id & 0xFF == ADDRESS:
                continue  # udp_multicast echoes our own frames
            pgn, data = pgn_of(frame.arbitration_id), bytes(frame.data)
            if pgn == REQUEST and int.from_bytes(data[:3], "little") == ADDRESS_CLAIMED:
                name = (1 << 63 | 2 << 60 | 255 << 40 | 1234).to_bytes(8, "little")
                bus.send(can.Message(arbitration_id=identifier(ADDRESS_CLAIMED, 6), data=name))
            elif pgn == STATUS:
                must_release = data[2] >> 6 == 1  # the machine wants to hear once that we do not steer
            elif pgn == EDGE_LINE:
                edge = None if data[:2] == b"\xff\xff" else line.decode(data)
            elif pgn == EDGE_QUALITY:  # the last frame of a cycle
                was_on = True
                curvature = 0.0 if edge is None else wanted_curvature(edge)
                steers = edge is not None and not must_release
                values = {"CurvatureCommand": -1000.0 * curvature, "CurvatureCommandStatus": int(steers)}
                bus.send(
                    can.Message(
                        arbitration_id=identifier(COMMAND, 3), data=command.encode(values, padding=True)
                    )
                )
            elif pgn == WHEEL and was_on and data[7] >> 2 & 3 == 0:
                return  # key switch off


if __name__ == "__main__":
    main()
