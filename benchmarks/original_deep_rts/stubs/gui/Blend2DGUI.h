// Stands in for the Blend2D window: it can be asked for, and there is none.
#pragma once

#include <stdexcept>

#include "Game.h"
#include "gui/BaseGUI.h"

namespace DeepRTS {
class Blend2DGUI : public BaseGUI {
public:
    explicit Blend2DGUI(Game& game) : BaseGUI(game) { throw std::runtime_error("no window here"); }
    const cv::Mat& render() const override { return renderData; }
    void onTileChange(const Tile&) override {}
};
}  // namespace DeepRTS
