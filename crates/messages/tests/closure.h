
/* A frame's flags with the closure of the left and of the right hand, 0 (open) to 1 (closed). NAN for a hand that is not
 * known. */
static inline uint32_t teleop_with_closure(uint32_t flags, float left, float right)
{
    const float hands[2] = { left, right };
    int side;
    flags &= ~(uint32_t)TELEOP_FLAG_CLOSURE;
    for (side = 0; side < 2; side++) {
        const float low = hands[side] < 0.0f ? 0.0f : hands[side];
        const float closure = low > 1.0f ? 1.0f : low;
        if (closure == closure) flags |= (uint32_t)(1.5f + 254.0f * closure) << (16 + 8 * side);
    }
    return flags;
}
