// SPDX-License-Identifier: Apache-2.0
// Values one behind the other, in memory that grows where it is and can be given away.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <type_traits>

namespace hil::wire {

// A std::vector copies what it holds to grow, and writes zeros before the values. realloc() moves
// the pages of a large block instead, and nothing here is written twice.
template <typename T> class Column {
	static_assert(std::is_trivially_copyable_v<T>);
	struct Free {
		void operator()(T *p) const noexcept { std::free(p); }
	};

public:
	size_t size() const { return size_; }
	T *data() { return data_.get(); }
	const T *data() const { return data_.get(); }
	T &back() { return data_.get()[size_ - 1]; }

	void push_back(T value) { *grow(1) = value; }

	// Makes room for `count` more, not initialised; returns where they stand until the next call.
	T *grow(size_t count)
	{
		if (capacity_ - size_ < count) {
			reserve(size_ + count + (size_ > kStart ? size_ : kStart));
		}
		size_ += count;
		return data_.get() + size_ - count;
	}

	// Gives the block away, to be freed by free(); what was not used of it goes back at once.
	T *release()
	{
		reserve(size_ ? size_ : 1);
		size_ = capacity_ = 0;
		return data_.release();
	}

private:
	static constexpr size_t kLarge = size_t{4} << 20;
	static constexpr size_t kStart = 4096 / sizeof(T);

	void reserve(size_t capacity)
	{
		T *moved = static_cast<T *>(std::realloc(data_.get(), capacity * sizeof(T)));
		if (!moved) {
			throw std::bad_alloc();
		}
		static_cast<void>(data_.release());
		data_.reset(moved);
		capacity_ = capacity;
		in_large_pages();
	}

	// A page fault for each 4 KiB would cost as much as all else that is done to the bytes.
	void in_large_pages()
	{
#ifdef MADV_HUGEPAGE
		constexpr uintptr_t page = 4096;
		const uintptr_t begin = reinterpret_cast<uintptr_t>(data_.get());
		const uintptr_t end = (begin + capacity_ * sizeof(T)) & ~(page - 1);
		const uintptr_t first = (begin + page - 1) & ~(page - 1);
		if (end > first && end - first >= kLarge) {
			// Advice: where it is not taken, nothing is lost.
			static_cast<void>(madvise(reinterpret_cast<void *>(first), end - first,
						  MADV_HUGEPAGE));
		}
#endif
	}

	std::unique_ptr<T, Free> data_;
	size_t size_ = 0;
	size_t capacity_ = 0;
};

} // namespace hil::wire
