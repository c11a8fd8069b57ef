/* The layout of a frame, for clients in C and C++ that publish over iceoryx2 0.10 (payload type name below, size and
 * alignment of the struct). Written by cargo test -p messages --test all clients -- --ignored; not to be edited. */
#ifndef TELEOPD_H
#define TELEOPD_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define TELEOP_ASSERT(is, what) static_assert(is, what)
#else
#define TELEOP_ASSERT(is, what) _Static_assert(is, what)
#endif

