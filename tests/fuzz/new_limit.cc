// Memory as the child that decodes Draco files has it: a limit for the sum of the blocks, beyond which
// operator new throws. Draco 1.5.5 reads the number of points of a kd-tree twice (bitstream 2.2); its arrays
// have the size that the second one gives, of which the head of the file says nothing.
#include <malloc.h>

#include <cstdlib>
#include <new>

namespace
{

constexpr std::size_t limit = std::size_t{1} << 30;
std::size_t in_use = 0;

void *try_take(std::size_t size) noexcept
{
    void *block = in_use < limit && size <= limit - in_use ? std::malloc(size) : nullptr;
    if (block) in_use += malloc_usable_size(block);
    return block;
}

void *take(std::size_t size)
{
    void *block = try_take(size);
    if (!block) throw std::bad_alloc();
    return block;
}

void give(void *block) noexcept
{
    in_use -= malloc_usable_size(block);
    std::free(block);
}

} // namespace

void *operator new(std::size_t size)
{
    return take(size);
}

void *operator new[](std::size_t size)
{
    return take(size);
}

void *operator new(std::size_t size, const std::nothrow_t &) noexcept
{
    return try_take(size);
}

void *operator new[](std::size_t size, const std::nothrow_t &) noexcept
{
    return try_take(size);
}

void operator delete(void *block) noexcept
{
    give(block);
}

void operator delete[](void *block) noexcept
{
    give(block);
}

void operator delete(void *block, std::size_t) noexcept
{
    give(block);
}

void operator delete[](void *block, std::size_t) noexcept
{
    give(block);
}
