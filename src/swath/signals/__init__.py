"""What flows between components: frozen, typed samples, SI and radians.

Every sample carries `t`, the simulated time [ns] it is valid for. Arrays are read-only by convention. What a
field means stands in its declaration (`core/signal.py`) and, as tables, in docs/reference/signals.md.
"""

from swath.core.signal import Signal as Signal
from swath.signals.arrays import F32 as F32
from swath.signals.arrays import F64 as F64
from swath.signals.arrays import I64 as I64
from swath.signals.arrays import U8 as U8
from swath.signals.arrays import U16 as U16
from swath.signals.arrays import Mask as Mask
from swath.signals.commands import SpeedCommand as SpeedCommand
from swath.signals.commands import SteerCommand as SteerCommand
from swath.signals.cooperation import BoxSeen as BoxSeen
from swath.signals.cooperation import HeapState as HeapState
from swath.signals.cooperation import PeerState as PeerState
from swath.signals.cooperation import Station as Station
from swath.signals.cooperation import TrailerState as TrailerState
from swath.signals.cooperation import UnloadCommand as UnloadCommand
from swath.signals.cooperation import UnloadState as UnloadState
from swath.signals.cooperation import box_unseen as box_unseen
from swath.signals.crop import CropAhead as CropAhead
from swath.signals.crop import CropEdge as CropEdge
from swath.signals.crop_sensors import FeedReading as FeedReading
from swath.signals.crop_sensors import GrainImage as GrainImage
from swath.signals.crop_sensors import LossReading as LossReading
from swath.signals.crop_sensors import ReturnsReading as ReturnsReading
from swath.signals.crop_sensors import YieldReading as YieldReading
from swath.signals.drivetrain import EngineState as EngineState
from swath.signals.drivetrain import MachineLoad as MachineLoad
from swath.signals.field_map import FieldMap as FieldMap
from swath.signals.ground_speed import GroundSpeed as GroundSpeed
from swath.signals.guidance import GuidanceState as GuidanceState
from swath.signals.header import CropFlow as CropFlow
from swath.signals.header import HeaderState as HeaderState
from swath.signals.image import Image as Image
from swath.signals.image import ImageBoxes as ImageBoxes
from swath.signals.image import ImageShares as ImageShares
from swath.signals.motion import MachineState as MachineState
from swath.signals.motion import SteerState as SteerState
from swath.signals.motion import WheelState as WheelState
from swath.signals.objects import Objects as Objects
from swath.signals.objects import objects_of as objects_of
from swath.signals.obstacles import OBSTACLE_KINDS as OBSTACLE_KINDS
from swath.signals.obstacles import Obstacles as Obstacles
from swath.signals.organs import CropStream as CropStream
from swath.signals.organs import OrganLoads as OrganLoads
from swath.signals.organs import OrganWork as OrganWork
from swath.signals.positioning import FIX_QUALITIES as FIX_QUALITIES
from swath.signals.positioning import Fix as Fix
from swath.signals.positioning import Inertial as Inertial
from swath.signals.positioning import Odometry as Odometry
from swath.signals.positioning import PoseEstimate as PoseEstimate
from swath.signals.scan import Scan as Scan
from swath.signals.scan import ScanTruth as ScanTruth
from swath.signals.scan import WindowState as WindowState
from swath.signals.scan import beam_directions as beam_directions
from swath.signals.settings import OrganSettings as OrganSettings
