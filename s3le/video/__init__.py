"""From a plain video to skeletons: decode, estimate in another process, judge, fill, filter."""
