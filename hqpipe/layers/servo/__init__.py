"""Servo: position command, or duty and supply voltage, to position; no torque is measured."""

from hqpipe.layers.servo.layer import Servo

__all__ = ["Servo"]
