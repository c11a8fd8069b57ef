import math
MIDDLE = {0: (0, 0, .98), 3: (-.01, 0, 1.07), 6: (-.02, 0, 1.17), 9: (-.02, 0, 1.28), 12: (-.04, 0, 1.47), 15: (0, 0, 1.59)}
LEFT = {1: (0, .096, .928), 4: (.018, .096, .499), 7: (0, .096, .068), 10: (.14, .114, .026), 13: (-.03, .053, 1.4),
        16: (-.04, .184, 1.432), 18: (-.04, .51, 1.432), 20: (-.04, .766, 1.432)}
def at(i):
    all = {**MIDDLE, **LEFT, **{j + 1: (x, -y, z) for j, (x, y, z) in LEFT.items()}}
    angle = 0.3 * math.sin(2 * math.pi * i / 240)
    for joint, length in ((18, .326), (20, .582)):
        all[joint] = (-.04, .184 + length * math.cos(angle), 1.432 + length * math.sin(angle))
    return [all[joint] for joint in range(22)]
