"""``dronerf bench mission``: whole missions with faults, in virtual time and over real UDP.

``cases`` says which faults happen when, ``virtual_flight`` and ``real_flight`` fly one mission
each, ``judge`` compares the truth with what safety asks for, ``measure`` collects the figures.
"""
