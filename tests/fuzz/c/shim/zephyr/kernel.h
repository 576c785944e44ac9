/* SPDX-License-Identifier: Apache-2.0 */
/* As much of Zephyr as the nodes' message handling uses, for one thread of the host. */
#ifndef SHIM_KERNEL_H_
#define SHIM_KERNEL_H_

#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <zephyr/sys/atomic.h>

#define ARG_UNUSED(x)     ((void)(x))
#define MIN(a, b)         ((a) < (b) ? (a) : (b))
#define IS_ENABLED(x)     0
#define K_FOREVER         (-1)
#define K_NO_WAIT         0
#define K_MSEC(x)         (x)
#define K_PRIO_PREEMPT(x) (x)

/* Threads do not run: the target calls what they would do. */
#define K_THREAD_DEFINE(name, stack, entry, p1, p2, p3, prio, options, delay)                      \
	void (*const name##_entry)(void *, void *, void *) = (entry)

struct k_spinlock {
	int unused;
};
typedef int k_spinlock_key_t;

static inline k_spinlock_key_t k_spin_lock(struct k_spinlock *lock)
{
	(void)lock;
	return 0;
}

static inline void k_spin_unlock(struct k_spinlock *lock, k_spinlock_key_t key)
{
	(void)lock;
	(void)key;
}

struct k_msgq {
	char *buffer;
	size_t size;
	size_t depth;
	size_t first;
	size_t count;
};

#define K_MSGQ_DEFINE(name, item_size, item_count, alignment)                                      \
	static char name##_buffer[(item_size) * (item_count)];                                     \
	static struct k_msgq name = {name##_buffer, (item_size), (item_count), 0, 0}

static inline int k_msgq_put(struct k_msgq *queue, const void *item, int timeout)
{
	(void)timeout;
	if (queue->count == queue->depth) {
		return -ENOMSG;
	}
	memcpy(queue->buffer + (queue->first + queue->count) % queue->depth * queue->size, item,
	       queue->size);
	queue->count++;
	return 0;
}

static inline int k_msgq_get(struct k_msgq *queue, void *item, int timeout)
{
	(void)timeout;
	if (queue->count == 0U) {
		return -ENOMSG;
	}
	memcpy(item, queue->buffer + queue->first * queue->size, queue->size);
	queue->first = (queue->first + 1U) % queue->depth;
	queue->count--;
	return 0;
}

static inline void k_msgq_purge(struct k_msgq *queue)
{
	queue->count = 0;
}

#endif
