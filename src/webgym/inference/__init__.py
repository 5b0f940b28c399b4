"""Models in this process: how a request becomes tokens and pixels, and what they reply.

What is here needs the extra ``train`` (torch, transformers); ``import webgym`` loads none of it.
"""
