"""What messages consist of, where a bag does not say it itself."""

from __future__ import annotations

from functools import cache

from gaitpref.console.extras import require

LOW_STATE = "unitree_go/msg/LowState"
SPORT_STATE = "unitree_go/msg/SportModeState"

_IMU = (
    "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\n"
    "float32[3] rpy\nint8 temperature\n"
)
_MOTOR = (
    "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nfloat32 q_raw\n"
    "float32 dq_raw\nfloat32 ddq_raw\nint8 temperature\nuint32 lost\n"
    "uint32[2] reserve\n"
)
_BATTERY = (
    "uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\n"
    "uint16 cycle\nint8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol\n"
)
_UNITREE = {
    LOW_STATE: (
        "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\n"
        "uint32[2] version\nuint16 bandwidth\nunitree_go/IMUState imu_state\n"
        "unitree_go/MotorState[20] motor_state\nunitree_go/BmsState bms_state\n"
        "int16[4] foot_force\nint16[4] foot_force_est\nuint32 tick\n"
        "uint8[40] wireless_remote\nuint8 bit_flag\nfloat32 adc_reel\n"
        "int8 temperature_ntc1\nint8 temperature_ntc2\nfloat32 power_v\n"
        "float32 power_a\nuint16[4] fan_frequency\nuint32 reserve\nuint32 crc\n"
    ),
    SPORT_STATE: (
        "unitree_go/TimeSpec stamp\nuint32 error_code\nunitree_go/IMUState imu_state\n"
        "uint8 mode\nfloat32 progress\nuint8 gait_type\nfloat32 foot_raise_height\n"
        "float32[3] position\nfloat32 body_height\nfloat32[3] velocity\n"
        "float32 yaw_speed\nfloat32[4] range_obstacle\nint16[4] foot_force\n"
        "float32[12] foot_position_body\nfloat32[12] foot_speed_body\n"
    ),
}
"""As unitree_ros2 publishes them (cyclonedds_ws/src/unitree/unitree_go/msg)."""
_UNITREE_PARTS = {
    "unitree_go/IMUState": _IMU,
    "unitree_go/MotorState": _MOTOR,
    "unitree_go/BmsState": _BATTERY,
    "unitree_go/TimeSpec": "int32 sec\nuint32 nanosec\n",
}


@cache
def definition_of(kind: str) -> str | None:
    """The text of a message `package/msg/Name` and its parts, as bags in MCAP carry it.

    Those of ROS itself come from rosbags. None: nobody knows it.

    Raises:
        MissingExtra: rosbags is not installed.
    """
    if kind in _UNITREE:
        line = "=" * 80
        parts = "".join(f"{line}\nMSG: {n}\n{t}" for n, t in _UNITREE_PARTS.items())
        return _UNITREE[kind] + parts
    typesys = require("rosbags.typesys", "logs")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    if kind not in store.types:
        return None
    return store.generate_msgdef(kind, ros_version=2)[0]
