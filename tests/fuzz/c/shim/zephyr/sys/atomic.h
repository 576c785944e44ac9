/* SPDX-License-Identifier: Apache-2.0 */
/* One thread: plain numbers will do. */
#ifndef SHIM_ATOMIC_H_
#define SHIM_ATOMIC_H_

typedef long atomic_t;

static inline long atomic_get(const atomic_t *target)
{
	return *target;
}

static inline long atomic_set(atomic_t *target, long value)
{
	long before = *target;

	*target = value;
	return before;
}

static inline long atomic_clear(atomic_t *target)
{
	return atomic_set(target, 0);
}

static inline long atomic_inc(atomic_t *target)
{
	return atomic_set(target, *target + 1);
}

#endif
