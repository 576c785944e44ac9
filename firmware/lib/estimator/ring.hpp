// SPDX-License-Identifier: Apache-2.0
#ifndef BV_ESTIMATOR_RING_HPP_
#define BV_ESTIMATOR_RING_HPP_

#include <array>

namespace bv
{

/// First in, first out, of at most N items; when full, a new item displaces the oldest.
template <class T, int N> class Ring
{
public:
	int size() const
	{
		return count_;
	}

	bool empty() const
	{
		return count_ == 0;
	}

	void clear()
	{
		count_ = 0;
	}

	void push(const T &item)
	{
		if (count_ == N) {
			pop();
		}
		items_[slot(count_)] = item;
		count_++;
	}

	/// Drop the oldest. Not on an empty ring.
	void pop()
	{
		first_ = (first_ + 1) % N;
		count_--;
	}

	/// The i-th oldest, 0 <= i < size().
	T &operator[](int i)
	{
		return items_[slot(i)];
	}

	const T &operator[](int i) const
	{
		return items_[slot(i)];
	}

private:
	static_assert((N & (N - 1)) == 0, "a power of two keeps the division out of every access");

	std::size_t slot(int i) const
	{
		return static_cast<std::size_t>(first_ + i) % N;
	}

	std::array<T, static_cast<std::size_t>(N)> items_{};
	int first_ = 0;
	int count_ = 0;
};

} // namespace bv

#endif // BV_ESTIMATOR_RING_HPP_
