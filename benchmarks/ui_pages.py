"""
The page that `python -m benchmarks.ui_libraries` looks at, made with one library: `python -m benchmarks.ui_pages panel`.

It has a picture and a text, nine buttons that change both, a button and an arrow key for a step, and an address that says what
is seen. Everybody who opens it has a page of their own.
"""

import base64
import io
import sys
from typing import Any
from urllib.parse import urlencode

import numpy as np
from PIL import Image

PORTS = {"nicegui": 8091, "panel": 8092, "gradio": 8093}
WIDTH = 352  # of the picture, as wide as the playground's


def picture(message: int, step: int) -> Image.Image:
    """:return: of random cells, which tells message and step in its first pixel"""
    pixels = np.random.default_rng((message, step)).integers(0, 255, (22, 22, 3), dtype=np.uint8).repeat(16, 0).repeat(16, 1)
    pixels[0, 0] = message, step, 0
    return Image.fromarray(pixels)


def text_of(message: int, step: int) -> str:
    return f"{message} after {step} steps"


def png(message: int, step: int) -> bytes:
    file = io.BytesIO()
    picture(message, step).save(file, "png")
    return file.getvalue()


def data_url(message: int, step: int) -> str:
    return "data:image/png;base64," + base64.b64encode(png(message, step)).decode()


def serve_nicegui() -> None:
    from nicegui import events, ui

    @ui.page("/")
    def page(message: int = 0, step: int = 0) -> None:
        def show(to: int, at: int) -> None:
            nonlocal message, step
            message, step = to, at
            image.props(f"src={data_url(message, step)}")
            text.set_text(text_of(message, step))
            ui.navigate.history.replace("?" + urlencode({"message": message, "step": step}))

        def key(event: events.KeyEventArguments) -> None:
            if event.action.keydown and event.key.arrow_right:
                show(message, step + 1)

        image = ui.element("img").props(f"src={data_url(message, step)}")
        text = ui.label(text_of(message, step))
        with ui.row():
            for n in range(9):
                ui.button(f"say {n}", on_click=lambda n=n: show(n, step)).props("no-caps")
            ui.button("step", on_click=lambda: show(message, step + 1)).props("no-caps")
        ui.keyboard(key)

    ui.run(host="127.0.0.1", port=PORTS["nicegui"], show=False, reload=False)


def serve_panel() -> None:
    import panel as pn
    import param

    class Keys(pn.custom.JSComponent):
        _esm = "export const render = ({model}) => document.addEventListener('keydown', e => model.send_msg(e.key))"

    class State(param.Parameterized):
        message = param.Integer(0)
        step = param.Integer(0)

        def one_step(self, _: Any = None) -> None:
            self.step += 1

    def page() -> Any:
        state = State()
        pn.state.location.sync(state, ["message", "step"])
        image = pn.pane.PNG(pn.bind(png, state.param.message, state.param.step))
        text = pn.widgets.StaticText(value=pn.bind(text_of, state.param.message, state.param.step))
        says = [pn.widgets.Button(name=f"say {n}", on_click=lambda _, n=n: state.param.update(message=n)) for n in range(9)]
        step = pn.widgets.Button(name="step", on_click=state.one_step)
        keys = Keys()
        keys.on_msg(lambda event: event.data == "ArrowRight" and state.one_step())
        return pn.Column(image, text, pn.Row(*says, step), keys)

    pn.serve(page, address="127.0.0.1", port=PORTS["panel"], show=False, compress_response=True)


def serve_gradio() -> None:
    import gradio as gr

    def shown(message: int, step: int) -> tuple[Any, ...]:
        query = urlencode({"message": message, "step": step})
        return (message, step), picture(message, step), text_of(message, step), "?" + query

    def restored(request: gr.Request) -> tuple[Any, ...]:
        return shown(int(request.query_params.get("message", 0)), int(request.query_params.get("step", 0)))

    with gr.Blocks() as page:
        state, image, text = gr.State((0, 0)), gr.Image(format="png"), gr.HTML()
        link = gr.Textbox(visible="hidden")
        everything = [state, image, text, link]
        each = {"inputs": state, "outputs": everything, "show_progress": "hidden"}
        each |= {"trigger_mode": "multiple", "concurrency_id": "page"}  # else quick clicks are lost, or overtake each other
        with gr.Row():
            for n in range(9):
                gr.Button(f"say {n}", min_width=10).click(lambda state, n=n: shown(n, state[1]), **each)
            gr.Button("step", min_width=10).click(lambda state: shown(state[0], state[1] + 1), **each)
        keys = gr.HTML(js_on_load="document.addEventListener('keydown', e => e.key == 'ArrowRight' && trigger('click'))")
        keys.click(lambda state: shown(state[0], state[1] + 1), **each)
        link.change(None, link, js="link => history.replaceState(null, '', link)")
        page.load(restored, outputs=everything, show_progress="hidden")
    page.launch(server_name="127.0.0.1", server_port=PORTS["gradio"])


SERVERS = {"nicegui": serve_nicegui, "panel": serve_panel, "gradio": serve_gradio}


def tell_lookups(event: str, what: tuple[Any, ...]) -> None:
    """Print the name of each host that is asked for."""
    if event == "socket.getaddrinfo":
        print("host", what[0], flush=True)


if __name__ == "__main__":
    sys.addaudithook(tell_lookups)
    SERVERS[sys.argv[1]]()
