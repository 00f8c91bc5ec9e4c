// Stands in for effolkronium/random: whole numbers between two bounds, both included.
#pragma once

#include <random>

namespace effolkronium {
struct random_static {
    static int get(int low, int high) {
        static std::mt19937 engine;
        return std::uniform_int_distribution<int>(low, high)(engine);
    }
};
}  // namespace effolkronium
