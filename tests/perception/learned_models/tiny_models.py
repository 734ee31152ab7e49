"""Writes models with random weights, small enough for tests, to folders as on Hugging Face."""

import json
from collections.abc import Callable
from pathlib import Path

import torch
from safetensors.torch import save_file
from tokenizers import Tokenizer, models, pre_tokenizers
from transformers import (
    BertTokenizer,
    GroundingDinoConfig,
    GroundingDinoForObjectDetection,
    PreTrainedTokenizerFast,
    Qwen2_5_VLConfig,
    Qwen2_5_VLForConditionalGeneration,
    Sam2VideoConfig,
    Sam2VideoModel,
    Sam3Config,
    Sam3Model,
    Sam3VideoConfig,
)

SAM2_SIDE, SAM3_SIDE = 128, 112
"""Side of the square input [px]."""


def word_tokenizer(*special: str) -> PreTrainedTokenizerFast:
    words = {word: k for k, word in enumerate(["[UNK]", "mug", "handle", ","])}
    tokenizer = Tokenizer(models.WordLevel(words, unk_token="[UNK]"))
    tokenizer.pre_tokenizer = pre_tokenizers.Whitespace()
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        additional_special_tokens=list(special),
        eos_token="<|im_end|>",
        pad_token="<|endoftext|>",
        unk_token="[UNK]",
    )


def save_rex_omni(folder: Path) -> None:
    """Writes a Qwen2.5-VL whose tokenizer has the tokens of boxes and coordinates."""
    tokenizer = word_tokenizer(
        *(f"<|{name}|>" for name in ("im_start", "vision_start", "vision_end", "image_pad")),
        *(f"<|{name}_{end}|>" for name in ("object_ref", "box") for end in ("start", "end")),
    )
    tokenizer.add_tokens([f"<{k}>" for k in range(1000)])
    ids = tokenizer.convert_tokens_to_ids
    config = Qwen2_5_VLConfig(
        text_config={
            "vocab_size": len(tokenizer),
            "hidden_size": 32,
            "intermediate_size": 64,
            "num_hidden_layers": 1,
            "num_attention_heads": 2,
            "num_key_value_heads": 1,
            "rope_parameters": {
                "rope_type": "default",
                "mrope_section": [2, 3, 3],
                "rope_theta": 1e4,
            },
            "bos_token_id": ids("<|endoftext|>"),
            "eos_token_id": ids("<|im_end|>"),
        },
        vision_config={
            "depth": 1,
            "hidden_size": 32,
            "intermediate_size": 64,
            "num_heads": 2,
            "out_hidden_size": 32,
            "fullatt_block_indexes": [0],
        },
        image_token_id=ids("<|image_pad|>"),
        vision_start_token_id=ids("<|vision_start|>"),
        vision_end_token_id=ids("<|vision_end|>"),
    )
    Qwen2_5_VLForConditionalGeneration(config).save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    save_image_processor("Qwen2VLImageProcessor", folder)


def save_grounding_dino(folder: Path) -> None:
    known = {0: "[PAD]", 7: "mug", 8: "handle", 100: "[UNK]", 101: "[CLS]", 102: "[SEP]"}
    known |= {103: "[MASK]", 1012: ".", 1029: "?"}  # The model knows the numbers of some tokens.
    vocabulary = {known.get(k, f"[unused{k}]"): k for k in range(1030)}
    config = GroundingDinoConfig(
        backbone_config={
            "model_type": "swin",
            "image_size": 64,
            "embed_dim": 8,
            "depths": [1, 1, 1, 1],
            "num_heads": [1, 1, 2, 2],
            "window_size": 2,
            "out_features": ["stage2", "stage3", "stage4"],
        },
        text_config={
            "model_type": "bert",
            "vocab_size": len(vocabulary),
            "hidden_size": 16,
            "num_hidden_layers": 1,
            "num_attention_heads": 2,
            "intermediate_size": 32,
        },
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        encoder_ffn_dim=32,
        decoder_ffn_dim=32,
        num_queries=6,
    )
    GroundingDinoForObjectDetection(config).save_pretrained(folder)
    BertTokenizer(vocab=vocabulary).save_pretrained(folder)
    size = {"shortest_edge": 64, "longest_edge": 96}
    save_image_processor("GroundingDinoImageProcessor", folder, size=size)


def save_sam2(folder: Path) -> None:
    """Writes a model for video, of which that for images is a part."""
    config = Sam2VideoConfig(
        vision_config={
            "backbone_config": {
                "model_type": "sam2_hiera_det_model",
                "hidden_size": 16,
                "image_size": [SAM2_SIDE, SAM2_SIDE],
                "blocks_per_stage": [1, 1, 2, 1],
                "embed_dim_per_stage": [16, 32, 64, 128],
                "num_attention_heads_per_stage": [1, 1, 2, 2],
                "window_size_per_stage": [4, 4, 4, 4],
                "global_attention_blocks": [3],
            },
            "backbone_channel_list": [128, 64, 32, 16],
            "fpn_hidden_size": 32,
            "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
        },
        prompt_encoder_config={
            "hidden_size": 32,
            "image_size": SAM2_SIDE,
            "mask_input_channels": 16,
        },
        mask_decoder_config={
            "hidden_size": 32,
            "mlp_dim": 64,
            "num_attention_heads": 2,
            "iou_head_hidden_dim": 32,
        },
        image_size=SAM2_SIDE,
        memory_attention_hidden_size=32,
        memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=32,
        memory_encoder_hidden_size=32,
        memory_encoder_output_channels=16,
        mask_downsampler_embed_dim=32,
        memory_fuser_embed_dim=32,
        memory_fuser_num_layers=1,
    )
    Sam2VideoModel(config).save_pretrained(folder)


def save_sam3(folder: Path) -> None:
    """Writes a model for video, with weights only of the part that is the model for images."""
    tokenizer = word_tokenizer()
    small = {"hidden_size": 32, "num_attention_heads": 2}
    transformer = {**small, "num_layers": 1, "intermediate_size": 64}
    config = Sam3Config(
        vision_config={
            "backbone_config": {
                **small,
                "model_type": "sam3_vit_model",
                "intermediate_size": 64,
                "num_hidden_layers": 2,
                "image_size": SAM3_SIDE,
                "window_size": 4,
                "global_attn_indexes": [1],
                "pretrain_image_size": 56,
            },
            "fpn_hidden_size": 32,
            "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
        },
        text_config={
            **small,
            "vocab_size": len(tokenizer),
            "intermediate_size": 64,
            "projection_dim": 32,
            "num_hidden_layers": 1,
            "max_position_embeddings": 32,
            "bos_token_id": 0,
            "eos_token_id": tokenizer.eos_token_id,
        },
        geometry_encoder_config=transformer,
        detr_encoder_config=transformer,
        detr_decoder_config={**transformer, "num_queries": 5},
        mask_decoder_config=small,
    )
    weights = Sam3Model(config).state_dict()
    prefixed = {f"detector_model.{name}": value for name, value in weights.items()}
    save_file(prefixed, folder / "model.safetensors", metadata={"format": "pt"})
    Sam3VideoConfig(detector_config=config.to_dict()).save_pretrained(folder)
    tokenizer.save_pretrained(folder)


def save_image_processor(name: str, folder: Path, **options: object) -> None:
    text = json.dumps({"image_processor_type": name, **options})
    (folder / "preprocessor_config.json").write_text(text)


def saved(save: Callable[[Path], None], folder: Path) -> str:
    """Returns a folder to which a model is written, with the same weights each time."""
    torch.manual_seed(0)
    save(folder)
    return str(folder)
