"""From a URDF of any humanoid to a robot file: `s3le robot new` and `s3le robot check`."""
