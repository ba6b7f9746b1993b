"""Retrieve, refine, certify: human motion in, certified robot motion out."""

from s3le.retarget.stream import Retargeter

__all__ = ["Retargeter"]
