"""A policy that is real in every respect but size: Qwen3-VL's architecture with about three million weights.

It acts through the same agent, browsers, parser, judge and trainer as a model of 8 B would, on websites made
for small viewports (``webgym.offline``, the small collection), so that the whole loop can be run, tested and
studied on two processors. What is here needs the extra ``train``.
"""
