// Stands in for the resource compiler: what it would have embedded is read from ASSETS_OF.
#pragma once

#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

namespace cmrc {
class file {
    std::string text;

public:
    explicit file(std::string read) : text(std::move(read)) {}
    const char* begin() const { return text.data(); }
    std::size_t size() const { return text.size(); }
};

class embedded_filesystem {
public:
    file open(const std::string& path) const {
        const std::string name = std::string(ASSETS_OF) + "/" + path;
        std::ifstream stream(name, std::ios::binary);
        if (!stream) throw std::runtime_error("cannot read " + name);
        return file({std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()});
    }
};
}  // namespace cmrc

#define CMRC_DECLARE(library)                                                    \
    namespace cmrc {                                                             \
    namespace library {                                                          \
    inline embedded_filesystem get_filesystem() { return embedded_filesystem(); } \
    }                                                                            \
    }                                                                            \
    static_assert(true, "")
