"""sim/scenes"""
