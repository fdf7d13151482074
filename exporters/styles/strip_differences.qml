<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: difference of two strips, purple where the later one saw the ground higher, orange where lower. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips">
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="marker" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="247,247,247,255"/>
      <Option name="name" type="QString" value="square"/>
      <Option name="outline_style" type="QString" value="no"/>
      <Option name="size" type="QString" value="0.25"/>
      <Option name="size_unit" type="QString" value="MapUnit"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="ramp_color(create_ramp(map(0, '#b35806', 0.25, '#fdb863', 0.5, '#f7f7f7', 0.75, '#b2abd2', 1, '#542788')), max(0, min(1, 0.5 + &quot;after_m&quot; / 0.04)))"/>
         <Option name="type" type="int" value="3"/>
        </Option>
        <Option name="size" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="field" type="QString" value="cell_m"/>
         <Option name="type" type="int" value="2"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;strip [% "strip_b" %] less strip [% "strip_a" %]&lt;/b&gt;&lt;br&gt;[% coalesce(format_number(1000 * "after_m", 1), '?') %] mm, with the stated mounting [% coalesce(format_number(1000 * "before_m", 1), '?') %] mm</mapTip>
</qgis>
